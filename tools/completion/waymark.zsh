#compdef waymark
# Completion of waymark for zsh: subcommands and options are asked of the program itself, so that they
# are never others than there are. Dictionaries too. Everything else are files.

# waymark_help COMMAND...: its subcommands, then its options, a line each.
_waymark_help() {
  "$@" --help 2>/dev/null | awk '
    /^[A-Za-z]+:/ { section = $1; next }
    section == "Subcommands:" && /^  [a-z]/ { print $1 }
    section == "Options:" && /^  -/ && match($0, /--[a-z-]+/) { print substr($0, RSTART, RLENGTH) }'
}

_waymark() {
  local -a command known
  local i
  command=("${words[1]}")
  # As many words as are subcommands.
  for ((i = 2; i < CURRENT; ++i)); do
    known=("${(@f)$(_waymark_help "${command[@]}")}")
    [[ "${words[i]}" != -* && ${known[(Ie)${words[i]}]} -gt 0 ]] || break
    command+=("${words[i]}")
  done
  if [[ "${words[CURRENT - 1]}" == --dictionary ]]; then
    # Refused, a name is answered with the list.
    known=(${=$("${words[1]}" print --dictionary '?' --ids 0 --marker-size 1 --out x.pdf 2>&1 |
      sed -n 's/.*known are//p')})
    compadd -- "${known[@]}"
    return
  fi
  known=("${(@f)$(_waymark_help "${command[@]}")}")
  if [[ "${words[CURRENT]}" == -* ]]; then
    compadd -- "${(@M)known:#-*}"
    return
  fi
  known=("${(@)known:#-*}")
  known=("${(@)known:#}")
  [[ ${#known} -eq 0 ]] || compadd -- "${known[@]}"
  _files
}

# Loaded by compinit, which calls the file as the function.
if [[ "${funcstack[1]}" == _waymark ]]; then _waymark "$@"; fi
