# A few short sequences against limits that were measured. Sourced by scripts/evaluate.

quick_plan=scripts/evaluation/quick.json
quick_limits=scripts/evaluation/quick_limits.json

# Prints what counts of a measured row; 0 and far off where it never found a pose, or not between its
# markers.
quick_values='(if .report then .report | (if .ends.gaps == 0 or .ends.lost > 0 then 1e3 else 0 end) as $lost | {
  end_mm: (.ends.from_marker_mm.worst + $lost), jump_mm: (.ends.jump_mm.worst + $lost),
  distance_mm: (if .markers.mapped < .markers.all then 1e3 else .distance_off_mm.worst end),
  posed_percent, within_3_sigma_percent: (100 - .beyond_3_sigma_percent)
} else {
  ate_live_mm: ((.live.ate_m.mean // 1e3) * 1000), ate_final_mm: ((.final.ate_m.mean // 1e3) * 1000),
  ace_mm: ((.final.ace_m.mean // 1e3) * 1000),
  in_view_percent: ((.live.in_view.share // 0) * 100)} end)'

# measure_quick_gaps ROW SEED FILE: poses between markers.
measure_quick_gaps() {
  run_bench gaps "$1" --runs 1 --seed "$2" --json "$work/gaps.json"
  jq -n --argjson row "$1" --argjson seed "$2" --argjson made "$(provenance)" \
    --slurpfile report "$work/gaps.json" \
    '{row: $row.name, seed: $seed, made: $made, report: $report[0][0]}' | write_json "$3"
}

# quick_rows SEEDS: measures every row for these seeds, or for its own.
quick_rows() {
  local kind row seed seeds file
  for kind in rows gaps; do
    while read -r row; do
      seeds=${1:-$(jq -r '.seeds | join(" ")' <<< "$row")}
      for seed in $seeds; do
        say "$(jq -r .name <<< "$row"), seed $seed"
        file=$measured/quick/$(jq -r .name <<< "$row")-seed$seed.json
        case "$kind" in
          rows) measure_row "$row" "$seed" "$file" ;;
          gaps) measure_quick_gaps "$row" "$seed" "$file" ;;
        esac
      done
    done < <(jq -c ".$kind[]" "$quick_plan")
  done
}

# Every value against its limit. Returns 1 when one is beyond.
quick_verdict() {
  jq -s --slurpfile limits "$quick_limits" "[.[] | . as \$r | $quick_values | to_entries[]
      | {row: \$r.row, seed: \$r.seed, what: .key, value,
         limit: \$limits[0].rows[\$r.row][.key].limit}
      | .ok = (if .what | endswith(\"_percent\") then .value >= .limit else .value <= .limit end)]" \
    "$measured"/quick/*.json > "$work/checks.json"
  {
    printf 'scene\tseed\twhat\tmeasured\tlimit\n'
    jq -r '.[] | [.row, .seed, .what, (.value * 1000 | round / 1000), .limit,
                  if .ok then "" else "BEYOND ITS LIMIT" end] | @tsv' "$work/checks.json"
  } | awk -F '\t' '{ printf "%-10s %4s  %-22s %9s %9s  %s\n", $1, $2, $3, $4, $5, $6 }'
  jq -e 'all(.ok)' "$work/checks.json" > /dev/null
}

# How far the seeds scatter, and from that the limits: the mean and four standard deviations. A value
# that had a closer limit before keeps all of that.
quick_derive_limits() {
  local before=$quick_limits
  [[ -f $before ]] || before=/dev/null
  jq -s --argjson made "$(provenance)" --arg seeds "$seeds" --slurpfile before "$before" "
    def closer(\$k; \$old; \$new):
      if \$old == null or \$old.limit == \$new.limit then \$new
      elif (\$k | endswith(\"_percent\")) == (\$old.limit > \$new.limit) then \$old else \$new end;
    {
      comment: \"Made by scripts/evaluate --quick-limits: what the seeds gave, and the limits, 4 standard deviations beyond the mean; where an earlier version had a closer one, that.\",
      made: \$made, seeds: \$seeds,
      rows: (group_by(.row) | map(.[0].row as \$row | {key: \$row, value: (map($quick_values) | . as \$all
        | [.[0] | keys_unsorted[]] | map(. as \$k | (\$all | map(.[\$k])) as \$v
          | (\$v | add / length) as \$mean
          | (\$v | map((. - \$mean) * (. - \$mean)) | add / (length - 1) | sqrt) as \$sd
          | (\$v | if \$k | endswith(\"_percent\") then min else max end) as \$worst
          | {key: \$k, value: ({mean: \$mean, sd: \$sd, worst: \$worst,
              limit: (if \$k | endswith(\"_percent\") then \$mean - 4 * \$sd else \$mean + 4 * \$sd end)}
              | map_values(. * 1000 | round / 1000)
              | closer(\$k; \$before[0].rows[\$row][\$k]; .))}) | from_entries)}) | from_entries)}" \
    "$measured"/quick/*.json | write_json "$quick_limits"
}
