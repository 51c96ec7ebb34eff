# Sourced by scripts/evaluate and scripts/bench; needs $work (scratch).

# build TARGET...: of the release, with tests/bench/. Prints only what failed.
build() {
  cmake --preset release -DWAYMARK_BENCH=ON > /dev/null
  cmake --build --preset release --target "$@" > "$work/build.log" ||
    { cat "$work/build.log" >&2; exit 1; }
}
