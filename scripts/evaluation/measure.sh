# One row of the tables: a run, measured, as a JSON file. Sourced by scripts/evaluate and
# scripts/compare-builds; needs $waymark, $work (scratch) and sequences.sh.

# Seconds before a loop closes in which the live trajectory may be worse than twice the final one.
seconds_before_loop=5

# The commit that is measured; changes of the documents do not count.
commit() {
  local dirty
  dirty=$(git status --porcelain --untracked-files=no -- . ':!docs' 2> /dev/null) || true
  printf '%s%s' "$(git rev-parse --short HEAD 2> /dev/null || echo unknown)" "${dirty:+-dirty}"
}

provenance() {
  jq -n --arg commit "$(commit)" --arg date "$(date -u +%Y-%m-%d)" \
    --arg cpu "$(nproc) cores of $(sed -n 's/^model name[[:space:]]*: //p' /proc/cpuinfo | head -n 1)" \
    '{commit: $commit, date: $date, cpu: $cpu}'
}

# write_json FILE: stdin to FILE, whole or not at all.
write_json() {
  mkdir -p "$(dirname "$1")"
  jq . > "$1.partial"
  mv "$1.partial" "$1"
}

# settings_file ROW: the configuration that `waymark run` gets for it.
settings_file() {
  { echo "[slam]"; jq -r '.settings[]?' <<< "$1"; } > "$work/settings.toml"
  printf '%s' "$work/settings.toml"
}

# run_simulated VIDEO TRUTH OPTION...: `waymark run` with what `waymark simulate` wrote beside a video.
run_simulated() {
  local video=$1 truth=$2
  shift 2
  "$waymark" run "$video" --calibration "$truth/calib.yml" --quiet \
    --dictionary "$(jq -r .dictionary "$truth/simulation.json")" \
    --marker-size "$(jq -r .marker_size_m "$truth/simulation.json")" "$@"
}

# measure_row ROW SEED FILE: renders, runs and evaluates a row of rows.json.
measure_row() {
  local row=$1 seed=$2 file=$3 arguments ignore video truth=$work/truth out=$work/out windows
  mapfile -t arguments < <(jq -r '.simulate[]' <<< "$row")
  arguments+=(--seed "$seed")
  mapfile -t ignore < <(jq -r 'if .ignore then "--ignore", .ignore[] else empty end' <<< "$row")
  video=$(render "${arguments[@]}")
  rm -rf "$truth" "$out"
  "$waymark" simulate "${arguments[@]}" --out "$truth" --truth-only
  run_simulated "$video" "$truth" --config "$(settings_file "$row")" \
    --save-detections "$out/detections.csv" --out "$out" || [[ $? -eq 3 ]]
  if [[ $(jq .localized "$out/stats.json") -eq 0 ]]; then # nothing to measure
    jq -n --argjson row "$row" --argjson seed "$seed" --argjson made "$(provenance)" \
      --slurpfile stats "$out/stats.json" \
      '{row: $row.name, seed: $seed, made: $made, stats: $stats[0]}' | write_json "$file"
    return
  fi
  "$waymark" eval --truth "$truth/gt_traj.txt" --estimate "$out/trajectory.tum" \
    --map "$out/map.json" --visible "$truth/gt_visible.csv" --json > "$work/live.json"
  mapfile -t windows < <(jq -r --argjson s $seconds_before_loop \
    '.loop_closed_at_s[] | "--skip", "\([0, . - $s] | max):\(. + 0.001)"' "$out/stats.json")
  "$waymark" eval --truth "$truth/gt_traj.txt" --estimate "$out/trajectory.tum" \
    "${windows[@]}" --json > "$work/settled.json"
  "$waymark" eval --truth "$truth/gt_traj.txt" --estimate "$out/trajectory_final.tum" \
    --truth-map "$truth/gt_map.json" --map "$out/map.json" --limit "$out/detections.csv" \
    --calibration "$truth/calib.yml" "${ignore[@]}" --json > "$work/final.json"
  jq -n --argjson row "$row" --argjson seed "$seed" --argjson made "$(provenance)" \
    --slurpfile stats "$out/stats.json" --slurpfile live "$work/live.json" \
    --slurpfile settled "$work/settled.json" --slurpfile final "$work/final.json" \
    '{row: $row.name, seed: $seed, made: $made, stats: $stats[0], live: $live[0],
      settled: $settled[0], final: $final[0]}' | write_json "$file"
}

# measure_corners FILE: the refined corners against the truth, by accuracy_test.
measure_corners() {
  build/release/tests/accuracy_test --gtest_filter='*CornerAccuracy.*' \
    --gtest_output="json:$work/corners.json" > "$work/corners.log" ||
    { cat "$work/corners.log" >&2; return 1; }
  jq --argjson made "$(provenance)" '{made: $made, scenes: [.testsuites[].testsuite[]
      | select(.scene) | {scene, corners, rms_px, bias_x_px, bias_y_px, bias_outward_px,
                          consistency}]}' "$work/corners.json" | write_json "$1"
}

# run_bench BENCH RUN ARGUMENT...: with the arguments of its row, and these.
run_bench() {
  local arguments
  mapfile -t arguments < <(jq -r '.arguments[]' <<< "$2")
  "build/release/tests/bench/$1" "${arguments[@]}" "${@:3}" >&2
}

# measure_long RUN FILE: very many frames of simulated corners.
measure_long() {
  run_bench long_run "$1" --json "$work/long_run.json"
  jq -n --argjson run "$1" --argjson made "$(provenance)" --slurpfile reports "$work/long_run.json" \
    '{run: $run.name, made: $made, reports: $reports[0]}' | write_json "$2"
}

# measure_constraints RUN FILE: drift along a wall, with what is known of it and without.
measure_constraints() {
  run_bench constraints "$1" --json "$work/constraints.json"
  jq -n --argjson run "$1" --argjson made "$(provenance)" --slurpfile known "$work/constraints.json" \
    '{run: $run.name, made: $made, known: $known[0]}' | write_json "$2"
}

# measure_building RUN FILE: a map that begins in pieces. A pose in any of them counts; errors are of
# the piece that most frames end in, and of all markers, each piece aligned by itself.
measure_building() {
  local seed arguments video truth=$work/truth out=$work/out all=$work/all.tum
  mapfile -t arguments < <(jq -r '.simulate[]' <<< "$1")
  rm -f "$work"/building-*.json
  for seed in ${seeds:-1 2 3}; do
    video=$(render "${arguments[@]}" --seed "$seed")
    rm -rf "$truth" "$out"
    "$waymark" simulate "${arguments[@]}" --seed "$seed" --out "$truth" --truth-only
    run_simulated "$video" "$truth" --save-detections "$out/detections.csv" --out "$out"
    cat "$out"/trajectory.tum "$out"/trajectory_[0-9]*.tum > "$all"
    "$waymark" eval --truth "$truth/gt_traj.txt" --estimate "$all" --map "$out/map.json" \
      --visible "$truth/gt_visible.csv" --json > "$work/live.json"
    "$waymark" eval --truth "$truth/gt_traj.txt" --estimate "$out/trajectory_final.tum" \
      --truth-map "$truth/gt_map.json" --map "$out/map.json" --limit "$out/detections.csv" \
      --limit-frames 1430 --calibration "$truth/calib.yml" --json > "$work/final.json"
    jq -n --argjson seed "$seed" --slurpfile stats "$out/stats.json" --slurpfile live "$work/live.json" \
      --slurpfile final "$work/final.json" \
      '{seed: $seed, frames: $stats[0].frames, localized: $stats[0].localized, markers: $stats[0].markers,
        begun: $stats[0].counters.pieces_begun, live: $live[0], final: $final[0]}' > "$work/building-$seed.json"
  done
  jq -n --argjson run "$1" --argjson made "$(provenance)" \
    '{run: $run.name, made: $made, seeds: [inputs]}' "$work"/building-*.json | write_json "$2"
}

# measure_joins RUN FILE: what frames take in which two pieces of the map become one.
measure_joins() {
  run_bench piece_join "$1" --json "$work/joins.json"
  jq -n --argjson run "$1" --argjson made "$(provenance)" --slurpfile sizes "$work/joins.json" \
    '{run: $run.name, made: $made, sizes: $sizes[0]}' | write_json "$2"
}

# measure_gaps RUN FILE: poses between markers; a row may have a figure of its first run.
measure_gaps() {
  local figure keep=()
  figure=$(jq -r '.figure // ""' <<< "$1")
  [[ -z $figure ]] || keep=(--keep "$work/frames") # rendered once for both
  run_bench gaps "$1" "${keep[@]}" --json "$work/gaps.json"
  [[ -z $figure ]] || run_bench gaps "$1" "${keep[@]}" --figure "$figure"
  jq -n --argjson run "$1" --argjson made "$(provenance)" --slurpfile report "$work/gaps.json" \
    '{run: $run.name, made: $made, report: $report[0][0]}' | write_json "$2"
}

# map_of_one_marker TRUTH_MAP ID FILE: a map.json that has this marker where it is.
map_of_one_marker() {
  jq -r --argjson id "$2" '.markers[] | select(.id == $id) | "%YAML:1.0\n---\n"
    + "aruco_bc_dict: ARUCO_MIP_36h12\naruco_bc_nmarkers: 1\naruco_bc_mInfoType: 1\n"
    + "aruco_bc_markers:\n   - { id:\(.id), corners:\(.corners | tojson) }"' "$1" > "$work/one.yml"
  "$waymark" map import --format aruco "$work/one.yml" "$3" >&2
}

# run_from_one PLACE FROM: poses of one recording of the scene `table` into $work/out, from what
# is at one place: a natural marker, or by its number the marker in its place.
run_from_one() {
  local from=$2 run=("$waymark" run "$2/frames.avi" --calibration "$2/calib.yml" --quiet)
  rm -rf "$work/out"
  if [[ $1 == [A-F] ]]; then
    "${run[@]}" --marker-size 0.1 --dictionary 4X4_50 --natural "$from/natural_$1.json" \
      --out "$work/out"
  else
    map_of_one_marker "$from/gt_map.json" "$1" "$work/one.json"
    "${run[@]}" --marker-size "$(jq '.markers[0].size' "$from/gt_map.json")" \
      --dictionary ARUCO_MIP_36h12 --map-in "$work/one.json" --localize-only --out "$work/out"
  fi || [[ $? -eq 3 ]]
}

# measure_targets TARGET FILE: the targets on the scene `table`, seen from poses that come from one
# natural marker, or one marker in its place, and what is between.
measure_targets() {
  local seed from place scene
  place=$(jq -r .place <<< "$1")
  scene=table
  [[ $(jq 'has("marker")' <<< "$1") == false ]] || scene=table_fiducials
  rm -f "$work"/targets-*.json
  for seed in ${seeds:-1 2 3}; do
    from=$(dirname "$(render "$scene" --seed "$seed")")
    run_from_one "$(jq -r '.marker // .place' <<< "$1")" "$from"
    build/release/tests/bench/targets "$from" "$work/out/trajectory.tum" --during "table $place" \
      --json "$work/targets-$seed.json" >&2
  done
  jq -n --arg name "$(jq -r .name <<< "$1")" --argjson made "$(provenance)" \
    '{name: $name, made: $made, seeds: [inputs]}' "$work"/targets-*.json | write_json "$2"
}

# reversed_images FROM TO: the images of a directory, last first, under new names.
reversed_images() {
  local image i=0
  mkdir -p "$2"
  while read -r image; do
    ln -s "$image" "$2/$(printf %06d $i).${image##*.}"
    i=$((i + 1))
  done < <(find "$(realpath "$1")" -maxdepth 1 -type f ! -name '*.txt' | LC_ALL=C sort -r)
}

# recording_source RECORDING FOLDER: prints what `waymark run` gets for it.
recording_source() {
  local source
  source=$2/$(jq -r .source <<< "$1")
  if [[ $(jq -r '.reversed // false' <<< "$1") == true ]]; then
    rm -rf "$work/reversed"
    reversed_images "$source" "$work/reversed"
    source=$work/reversed
  fi
  printf '%s' "$source"
}

# run_recording RECORDING FOLDER SOURCE OPTION...: `waymark run` with what its row says.
run_recording() {
  local recording=$1 from=$2 source=$3 extra
  shift 3
  mapfile -t extra < <(jq -r '.options[]?' <<< "$recording")
  [[ $(jq '.calibrated' <<< "$recording") == false ]] || extra+=(--calibration "$from/calib.yml")
  "$waymark" run "$source" --quiet \
    --dictionary "$(jq -r .dictionary <<< "$recording")" \
    --marker-size "$(jq -r .size_m <<< "$recording")" "${extra[@]}" "$@"
}

# surveyed_markers RECORDING FOLDER: a configuration in which the markers of a tagslam.yaml are anchors.
surveyed_markers() {
  "$waymark" map import "$2/$(jq -r .anchors.file <<< "$1")" --format tagslam \
    --dictionary "$(jq -r .dictionary <<< "$1")" "$work/survey.json" > /dev/null
  printf '[slam]\ndictionary = "%s"\nmarker_size_m = %s\n' "$(jq -r .dictionary <<< "$1")" "$(jq -r .size_m <<< "$1")"
  jq -r --argjson of "$(jq .anchors <<< "$1")" '.markers[]
    | "[[slam.markers.anchors]]\nid = \(.id)\np_m = \(.T_w_m.p | tojson)\nq_wxyz = \(.T_w_m.q | tojson)\n" +
      "sigma_m = \($of.sigma_m)\nsigma_rad = \($of.sigma_rad)"' "$work/survey.json"
}

# measure_in_pieces RECORDING FOLDER KEPT FILE: recorded corners of a building whose markers are seldom seen
# together.
measure_in_pieces() {
  local recording=$1 from=$2 kept=$3 file=$4 options=() ignored seen
  local detections=$from/detections.csv
  if [[ $(jq 'has("anchors")' <<< "$recording") == true ]]; then
    surveyed_markers "$recording" "$from" > "$work/survey.toml"
    options+=(--config "$work/survey.toml")
  fi
  rm -rf "$kept"
  run_recording "$recording" "$from" "$detections" --out "$kept" "${options[@]}"
  mapfile -t ignored < <(jq -r '.ignore[]' <<< "$recording")
  "$waymark" eval --json --truth "$from/gt_traj.txt" --estimate "$kept/trajectory_final.tum" \
    --truth-map "$from/gt_map.json" --map "$kept/map.json" --ignore "${ignored[@]}" \
    --limit "$detections" --limit-frames 100000 --calibration "$from/calib.yml" > "$work/truth.json"
  seen=$(grep -v '^[#t]' "$detections" | cut -d, -f1 | sort -u | wc -l)
  jq -n --argjson recording "$recording" --argjson made "$(provenance)" --argjson seen "$seen" \
    --slurpfile stats "$kept/stats.json" --slurpfile truth "$work/truth.json" \
    '{recording: $recording.name, made: $made, stats: $stats[0], frames_with_marker: $seen, truth: $truth[0]}' |
    write_json "$file"
}

# measure_recording RECORDING FOLDER KEPT FILE: a real recording. Its map and picture stay in KEPT.
measure_recording() {
  local recording=$1 from=$2 kept=$3 file=$4 source extra options=() other map_rms_px
  mapfile -t extra < <(jq -r '.options[]?' <<< "$recording")
  source=$(recording_source "$recording" "$from")
  rm -rf "$kept"
  run_recording "$recording" "$from" "$source" --out "$kept"
  # The limit is one of the corners as the given lens undistorts them.
  [[ -f $from/gt_traj.txt && $source == *.csv && ${#extra[@]} -eq 0 ]] &&
    options+=(--limit "$source" --calibration "$from/calib.yml")
  [[ -f $from/gt_traj.txt ]] &&
    options+=(--truth "$from/gt_traj.txt" --estimate "$kept/trajectory_final.tum")
  [[ -f $from/gt_map.json ]] && options+=(--truth-map "$from/gt_map.json" --map "$kept/map.json")
  echo '{}' > "$work/truth.json"
  [[ ${#options[@]} -eq 0 ]] || "$waymark" eval "${options[@]}" --json > "$work/truth.json"
  echo '{}' > "$work/other.json"
  other=$(jq -r '.same_map_as // empty' <<< "$recording")
  [[ -z $other || ! -f $kept/../$other/map.json ]] ||
    "$waymark" eval --truth-map "$kept/../$other/map.json" --map "$kept/map.json" --json > "$work/other.json"
  map_rms_px=$("$waymark" map info "$kept/map.json" | awk '$1 == "fit" && !told++ { print $2 }')
  jq -n --argjson recording "$recording" --argjson made "$(provenance)" \
    --argjson map_rms_px "${map_rms_px:-null}" --slurpfile stats "$kept/stats.json" --slurpfile truth "$work/truth.json" \
    --slurpfile other "$work/other.json" \
    '{recording: $recording.name, made: $made, stats: $stats[0], map_rms_px: $map_rms_px, truth: $truth[0],
      other: $other[0]}' | write_json "$file"
}
