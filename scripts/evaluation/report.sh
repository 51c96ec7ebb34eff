# docs/results.md from the measured rows. Sourced by scripts/evaluate.

header() {
  cat << END
# Results

Assembled by \`scripts/evaluate\` on $(date -u +%Y-%m-%d); every row says which version it was measured
on ("-dirty": with changes that were not committed), on $(jq -rs 'map(.made.cpu) | unique | join("; ")' "$@" /dev/null).
Every number is measured by the programs of this repository; run the script to get yours.

ATE: mean distance between estimated and true camera positions after rigid alignment (no scale).
ACE: the same for the marker corners. t_rel and r_rel: relative errors over 25 cm (seed 1, section 5).
*Live* is what a subscriber gets; *final* is against the map after global optimization. Whether errors
have the covariance that is told of them: [consistency.md](consistency.md). What a lens costs that nobody has
measured, or measured badly: [lens.md](lens.md). Pictures on the wall, by distance, tilt and number: [natural.md](natural.md).
END
}

# The text before each table.
texts() {
  jq -n --arg accuracy "\
Markers of ARUCO_MIP_36h12; noise of 2 grey levels, blur of 0.6 pixels and no motion blur where the
scene says nothing else. *In view of a mapped marker*: frames with a pose among those in which a
marker of the final map, 20 pixels or more a side, is wholly in view and not in the dark. *Limit*:
bundle adjustment of 180 frames with the same corners, started from the truth; what it leaves is the
corners' fault, and the goal is to stay within 1.2 times it. *Live / final*: ATE of the live
trajectory, without the $seconds_before_loop seconds before a loop closes, over that of the final one; the goal
is 2. Marker moved, id printed twice: errors are counted on the other markers, and the target is the
clean walls of the same seed and 1 mm.

$(jq -r '.rows[] | select(.target) | "- `\(.name)`: \(.what)"' "$plan")

UcoSLAM, the successor of the paper's system by its authors, reaches 33 to 220 mm on comparable walls,
16 to 18 mm on ceilings, 230 mm and 60 % of the frames on a revisit, 2.0 and 0.40 mm on the box and
56 mm in the lab; a moved marker or a doubled id breaks its map (297 and 569 mm)." \
    --arg timing "\
CPU time of the SLAM thread per frame: mean / 99th percentile / longest. t_rel and r_rel of the live
trajectory." \
    --arg table_1 "\
Two rooms, 90 markers, 12480 frames; the paper's are of its laboratory with a laser scanner as the
reference, ours of the scene \`lab\`, on another computer. Frames per second are of wall time, one
thread. N_c is \`slam.mapper.keyframes.views_per_marker\`." \
    --arg table_2 "\
The paper's sequences had a motion-capture reference; ours are scenes of the same kind with exact
truth, so this compares ranges, not sequences." \
    --arg corners "\
Refined corners against the projected truth, markers with sides of 20 pixels and more. Consistency is
the mean squared error in units of the corner's own covariance: 1 is exact, less is cautious." \
    --arg long "\
Corners projected from the truth with 0.1 px of noise, no images. CPU time of the SLAM thread per frame;
each line is of the frames since the line before, ATE too." \
    --arg constraints "\
Somebody walks once along a corridor with markers of 16 cm on one wall only, a metre apart, and never comes
back: 640x480, 30 fps, 1.6 m from the wall, corners projected from the truth with 0.3 px of noise, lens known.
*Drift*: how far the last three markers are from the truth on the average, where the map's first quarter
lies on it; of it *along* the wall, *out* of it and *up*. *Told*: the standard deviation of their places in the
world of the first keyframe, as the map has it, and NEES there, where 3 is expected. *One plane*: all of
them hang on one wall, whatever it is (3 mm, 0.01 rad); *two distances*: a tape of half the length from the first
to the middle one, and on to the last (3 mm). The truth has these errors.
\`build/release/tests/bench/constraints\` is the same by itself." \
    --arg buildings "\
Scene \`building\`: a corridor of 24 m with three rooms on either side, 60 markers; a walker goes through all of
them and back past their doors in 286 s. But for the first room, no frame shows markers of a room and of the corridor until
the way back. *With a marker in view*: frames with a pose in some piece among those in which a marker, 20 pixels or more a
side, is wholly in view. *Limit*: bundle adjustment of 1,430 of the frames (at 2 Hz of all) with the same corners, started from the truth;
what it leaves is how badly markers alone, 9 to 15 pixels large through a door, hold the rooms together. Natural features
hold them better." \
    --arg joins "\
Two halls, each a piece of the map: the camera walks through the one, is carried into the other in the dark, and then a door
between them opens. Corners projected from the truth with 0.1 px of noise, no images, at 150 Hz, where a frame
has 6.67 ms. CPU time of the SLAM thread per frame, the least of three runs, all of which do the same work: *before* any frame shows markers of both;
*joining*, from the first of these until both are one; *after*, to the end. When all of a joint was one frame's work, the longest of *joining* took 0.7, 2.6 and 5.8 ms.
\`build/release/tests/bench/piece_join\` is the same by itself." \
    --arg gaps "\
Rendered scenes, three seeds, as live, with the lens known: from the last frame with a marker on there is
nothing but natural features. *Off at the end*: the last carried pose against the truth, seen from the
marker before the gap; *jump*: of the published pose at the next marker, beside the camera's own motion;
NEES: 6 is expected, and beyond 54 an error is more than three standard deviations in every coordinate.
*Longest beyond 3 sigma*: how long at a time a position, of any pose, is farther off than three times what its
covariance says in the direction of that error. *Scale*: of the way since the last marker, along it, and what
the covariance tells of the end's place in that direction, in which the doubt about the way's beginning is as well, both rms. *Markers in the map*: of all runs, the live
map that the camera is in; the first way ends at half the time where the camera comes back to where it began,
in the middle of the corridor's turn at its far end. CPU time of the whole
SLAM thread, and what natural features take of it. A lost gap, which ends without a pose, meets no target.
The paper's own gap of 3.5 m ends with a jump of 1.2 m, the best peer's of 2.4 m 5.6 to
6.8 cm off, for 25 ms a frame and 345 at worst. More runs, and Davison's own recording from its four known points:
[consistency.md](consistency.md#between-markers).

![dolly at 320x240: errors and way over time](dolly.svg)

The first run at 320x240, as the paper's figures 5 to 8 have it (x along the wall, y towards it), and the
same with markers alone, which have no pose in the gap and none after it: the two markers are never
seen together." \
    --arg targets "\
Scene \`table\`, 640x480, three seeds: the camera knows one picture on or behind the table, and where it
hangs; it passes by the others, and twenty that are unknown. Distance in the image between each of eleven
targets through the estimated pose and through the true one: in the four seconds before the table after the
camera has looked at the picture, as the paper measured it, and in all frames with a pose, which are up to
a minute and several metres from the picture. The paper's (table 1, at 320x240) are 10 to 14 px from 0.4 to 0.8 m,
over 100 px from 1 m, and none from 2 m. *A-marker* to *F-marker*: scene \`table_fiducials\`, from one marker
of ARUCO_MIP_36h12 in the place of the picture, the only one that the camera knows." \
    --arg recordings "\
References: printed board layouts for aruco_chess18 and gridboard20; for tagslam an offline batch
solution of the same corners, so agreement rather than truth. ACE after rigid alignment. room20 is run
a second time with its photographs in reverse order; both maps are compared. *Limit*: as above, from
the reference instead of a truth. The reference of tagslam_det_13 also knew that its tags hang on
boards, and a measured distance; corners alone do not agree with it better than the limit. *_lens*:
with \`--refine-intrinsics\`. Pictures of the maps to
look at: \`${kept#"$PWD"/}/*/map.svg\`." \
    --arg in_pieces "\
tagslam_det_10: corners of 81 tags in 30 minutes, seldom two at once; tags that were ever seen in one frame
make five groups. ACE of each piece by itself against the reference, which is an offline batch solution held by a
survey of its tags to half a metre; id 20 hangs three times, and is left out. *Limit*: bundle
adjustment of all frames with the same corners, started from the reference, which knows how the groups lie to each other." '$ARGS.named'
}

# assemble FILE: the report from all that was measured.
assemble() {
  local rows=("$measured"/rows/*.json) recordings=("$measured"/recordings/*.json) long=("$measured"/long/*.json) gaps=("$measured"/gaps/*.json)
  local constraints=("$measured"/constraints/*.json)
  local buildings=("$measured"/buildings/*.json) joins=("$measured"/joins/*.json)
  local targets=("$measured"/targets/*.json) corners=$work/null.json
  echo null > "$work/null.json"
  [[ -f $measured/corners.json ]] && corners=$measured/corners.json
  jq -s . "${rows[@]}" /dev/null > "$work/rows.json"
  jq -s . "${recordings[@]}" /dev/null > "$work/recordings.json"
  jq -s . "${long[@]}" /dev/null > "$work/long_runs.json"
  jq -s . "${gaps[@]}" /dev/null > "$work/gap_runs.json"
  jq -s . "${targets[@]}" /dev/null > "$work/target_runs.json"
  jq -s . "${buildings[@]}" /dev/null > "$work/building_runs.json"
  jq -s . "${joins[@]}" /dev/null > "$work/join_runs.json"
  jq -s . "${constraints[@]}" /dev/null > "$work/constraint_runs.json"
  texts > "$work/texts.json"
  jq -nr --slurpfile plans "$plan" --slurpfile rows "$work/rows.json" --slurpfile text "$work/texts.json" \
    --slurpfile seen "$work/recordings.json" --slurpfile corner "$corners" \
    --slurpfile walks "$work/long_runs.json" --slurpfile between "$work/gap_runs.json" \
    --slurpfile points "$work/target_runs.json" --slurpfile bounds "$work/constraint_runs.json" \
    --slurpfile houses "$work/building_runs.json" --slurpfile doors "$work/join_runs.json" \
    --arg header "$(header "${rows[@]}")" \
    "\$plans[0] as \$plan | \$rows[0] as \$results | \$seen[0] as \$recordings | \$walks[0] as \$long | \$between[0] as \$gaps | \$points[0] as \$targets | \$bounds[0] as \$constraints | \$houses[0] as \$buildings | \$doors[0] as \$joins | \$corner[0] as \$corners
     | \$text[0] as \$text | $(sed '/^#/d' scripts/evaluation/report.jq)" > "$1.partial"
  mv "$1.partial" "$1"
}
