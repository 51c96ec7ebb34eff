# Rendered sequences, kept outside the tree. Sourced by scripts/evaluate and scripts/compare-builds;
# needs $waymark.

cache="${XDG_CACHE_HOME:-$HOME/.cache}/waymark/sequences"

# Whatever decides a pixel: the simulator's sources and what it takes from slam/, not the truth
# files, which are written anew each time.
renderer_version() {
  {
    find simulator -name '*.cc' -o -name '*.h' | grep -v -e '_test\.cc$' -e /testing/ -e /live_source -e /observed_corners -e /projected_marker -e /truth_files -e /simulation_json
    ls slam/detection/codes/dictionary*.cc slam/detection/codes/dictionary*.h | grep -v _test
    ls slam/detection/marker_detection.h slam/geometry/camera_model.* slam/geometry/transform.h | grep -v _test
    echo cmake/WaymarkBuild.cmake
  } | LC_ALL=C sort | xargs sha256sum | sha256sum | cut -c1-12
}

# sequence_name ARGUMENT...: the cache's name for `waymark simulate ARGUMENT...`.
sequence_name() {
  printf '%s-%s-%s' "$1" "$renderer" "$(printf '%s\n' "$@" | sha256sum | cut -c1-12)"
}

# render ARGUMENT...: prints where frames.avi of `waymark simulate ARGUMENT...` is; renders it first
# where it is not there. A sequence gets its name when it is whole.
render() {
  local name directory partial lock
  name=$(sequence_name "$@")
  directory=$cache/$name
  mkdir -p "$cache"
  exec {lock}> "$cache/$name.lock"
  flock "$lock" # another run may be rendering the same
  if [[ ! -d $directory ]]; then
    partial=$cache/$name.partial
    rm -rf "$partial" # what a killed run left
    say "  rendering: simulate $*"
    "$waymark" simulate "$@" --out "$partial" --quiet
    printf '%s\n' "$*" > "$partial/arguments"
    mv -T "$partial" "$directory"
  fi
  exec {lock}>&-
  printf '%s' "$directory/frames.avi"
}

# Removes what an older renderer made, and what killed runs left.
prune() {
  [[ -d $cache ]] || return 0
  find "$cache" -mindepth 1 -maxdepth 1 \( -name '*.partial' -o ! -name "*-$renderer-*" \) -exec rm -rf {} +
}
