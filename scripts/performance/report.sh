# docs/performance.md and docs/detection.md from what scripts/bench measured. Sourced by it.

performance_report() {
  local measured=$1 file
  cat << 'END'
# Performance

Made by `scripts/bench`: thread CPU time on one core, milliseconds a frame, detection and SLAM
together. "Following" is the default; "full scans" searches every frame as a whole
(`slam.follower.enabled = false`). In brackets what it is meant to become.

| sequence | search | mean | median | p99 | worst | frames scanned as a whole |
|---|---|---|---|---|---|---|
END
  for file in "$measured"/*.json; do
    jq -r '
      def ms: . * 1000 | round / 1000 | tostring;
      def row($name; $mode; $s; $t): $s.timing.total.cpu_ms as $c
        | "| \($name) | \($mode) | \($c.mean | ms)\($t[0]) | \($c.median | ms) | \($c.p99 | ms)\($t[1]) | \($c.max | ms)\($t[2]) | \($s.counters.full_scans) of \($s.frames) |";
      row(.name; "following"; .following; .targets | map(" [\(.)]")),
      row(""; "full scans"; .full; ["", "", ""])' "$file"
  done
  cat << 'END'

Where the time goes when following, milliseconds (mean, p99, worst), and what following keeps of the
corners that full scans find on markers of 20 pixels and more:

| sequence | detection | tracking | mapping | kept | apart, px RMS |
|---|---|---|---|---|---|
END
  for file in "$measured"/*.json; do
    jq -r '
      def ms: . * 1000 | round / 1000 | tostring;
      def stage($s): $s.cpu_ms | "\(.mean | ms), \(.p99 | ms), \(.max | ms)";
      .following.timing as $t
      | "| \(.name) | \(stage($t.detect)) | \(stage($t.track)) | \(stage($t.map)) | \(10000 * .kept.kept / .kept.of | round / 100) % of \(.kept.of) | \(.kept.apart_px) |"' \
      "$file"
  done
  if [[ -f $measured/detectors.txt ]]; then
    printf '\nFull scans beside the detectors of Debian 12, the same frames in the same run; the second of\neach pair with noise of 5 grey levels:\n\n```\n'
    cat "$measured/detectors.txt"
    printf '```\n'
  fi
  if [[ -f $measured/clutter.txt ]]; then
    printf '\nThe same on clutter (`tests/bench/clutter.h`): squares, frames, grids, chessboards, writing, and not a\nsingle marker:\n\n```\n'
    cat "$measured/clutter.txt"
    printf '```\n'
  fi
  if [[ -f $measured/live.txt ]]; then
    printf '\nThe daemon on a simulated camera, 640x480, as a subscriber sees it (`waymark echo --stats`),\nten minutes at 150 Hz and one at 1000 Hz, where more frames may come than it can take, and the newest\nwin:\n\n```\n'
    cat "$measured/live.txt"
    printf '```\n'
  fi
  if [[ -f $measured/hall.txt ]]; then
    printf '\nA map of 2,000 markers, corners only, no detection; the markers are mapped on the first round:\n\n```\n'
    cat "$measured/hall.txt"
    printf '```\n'
  fi
  if [[ -f $measured/patterns.txt ]]; then
    cat << 'END'

## Patterns

Images full of dark things (`tests/bench/patterns.h`), detection alone, milliseconds of thread CPU time
a frame: a perforated panel's squares, a grille's discs, a facade's windows, text, leaves, noise; moving
2 pixels a frame at 30 Hz. "In view": without a marker, and so never followed. "Following": with two
markers, and two more that appear in the middle of the sequence. "Times": the worst frame, of all or of
those following, against the worst ordinary one (of the walls, searched as a whole); at most 3 is meant.
"Findable": how many of the four a search finds that looks at everything. "Found after", "new after": frames until
these are all found, without following and with; 15 are meant. "Missed":
frames in which a followed marker was not found.

```
END
    cat "$measured/patterns.txt"
    printf '```\n'
  fi
  printf '\n'
  for file in "$measured"/*.json; do
    jq -r '"\(.name): version \(.made.commit), \(.made.date), \(.made.cpu), load \(.load)."' "$file"
  done
}

# recall_report FILE: docs/detection.md, of what tests/bench/recall has printed.
recall_report() {
  cat << 'END'
# Which markers are found

Made by `scripts/bench --scenes recall`: single markers of AprilTag 36h11 on paper with a white margin of
one cell, rendered (`simulator/testing/marker_photo.h`) with sides of 7 to 800 pixels, a Gaussian blur with a
standard deviation of 0.5 to 8 pixels beside the pixel's own area, noise of 2, 5 and 10 grey levels, and
tilts of 0, 30 and 60 degrees; ours beside OpenCV's ArUco (sub-pixel corners) and AprilTag 3 (full
resolution, edges refined), as Debian 12 has them. A side has eight cells: where the blur is more than half
of one, nobody can read the code.

![Markers found by side and blur](recall.svg)

A marker that is too soft for its edges to be fitted at full size is found at a quarter of it, and measured
at the largest size at which its blur is a pixel or two. *Mean squared error of a corner in units of its
covariance*: 1 is exact, less is cautious; large sharp markers have less, as 0.03 pixels that the grey
levels do not show (print, paper, lens) are reckoned with.

What the paper does shows in the covariance: sides that are curved beyond chance (bent paper, a lens that is
not as given) are fitted as curves, so that corners stay where the print's are, and all four corners may be
off by the largest bow, as they are not those of a square any more; a paper whose margin is narrow against the
blur adds to the sides that it moves. `tests/difficult_corners_test.cc` holds both to it.

```
END
  cat "$1"
  printf '```\n\nVersion %s, %s.\n' "$(commit)" "$(date -u +%Y-%m-%d)"
}
