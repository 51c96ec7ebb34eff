# Completion of waymark for bash: subcommands and options are asked of the program itself, so that
# they are never others than there are. Dictionaries too. Everything else are files.

_waymark_help() {
  local section
  "$@" --help 2>/dev/null | while IFS= read -r line; do
    case $line in
      Subcommands:) section=commands ;;
      Options:) section=options ;;
      [A-Za-z]*:) section= ;;
      "  "[a-z]*)
        if [[ $section == commands ]]; then
          set -- $line
          echo "$1"
        fi
        ;;
      "  "-*)
        if [[ $section == options && $line =~ (--[a-z-]+) ]]; then echo "${BASH_REMATCH[1]}"; fi
        ;;
    esac
  done
}

_waymark() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]}
  local command=("${COMP_WORDS[0]}") known i
  COMPREPLY=()
  # As many words as are subcommands.
  for ((i = 1; i < COMP_CWORD; ++i)); do
    known=" $(_waymark_help "${command[@]}" | grep -v '^-' | tr '\n' ' ')"
    [[ $known == *" ${COMP_WORDS[i]} "* ]] || break
    command+=("${COMP_WORDS[i]}")
  done
  if [[ $before == --dictionary ]]; then
    # Refused, a name is answered with the list.
    known=$("${COMP_WORDS[0]}" print --dictionary '?' --ids 0 --marker-size 1 --out x.pdf 2>&1 |
      sed -n 's/.*known are//p')
    COMPREPLY=($(compgen -W "$known" -- "$word"))
    return
  fi
  known=$(_waymark_help "${command[@]}")
  if [[ $word == -* ]]; then
    COMPREPLY=($(compgen -W "$(grep '^-' <<<"$known")" -- "$word"))
  else
    COMPREPLY=($(compgen -W "$(grep -v '^-' <<<"$known")" -- "$word"))
    [[ ${#COMPREPLY[@]} -gt 0 ]] || COMPREPLY=($(compgen -f -- "$word"))
  fi
}

complete -o filenames -F _waymark waymark
