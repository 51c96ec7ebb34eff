# A few short sequences against limits that were measured. Sourced by scripts/evaluate.

quick_plan=scripts/evaluation/quick.json
quick_limits=scripts/evaluation/quick_limits.json

# Prints what counts of a measured row; 0 and far off where it never found a pose.
quick_values='{
  ate_live_mm: ((.live.ate_m.mean // 1e3) * 1000), ate_final_mm: ((.final.ate_m.mean // 1e3) * 1000),
  ace_mm: ((.final.ace_m.mean // 1e3) * 1000),
  in_view_percent: ((.live.in_view.share // 0) * 100)}'

# quick_rows SEEDS: measures every row for these seeds, or for its own.
quick_rows() {
  local row seed seeds file
  while read -r row; do
    seeds=${1:-$(jq -r '.seeds | join(" ")' <<< "$row")}
    for seed in $seeds; do
      say "$(jq -r .name <<< "$row"), seed $seed"
      file=$measured/quick/$(jq -r .name <<< "$row")-seed$seed.json
      measure_row "$row" "$seed" "$file"
    done
  done < <(jq -c '.rows[]' "$quick_plan")
}

# Every value against its limit. Returns 1 when one is beyond.
quick_verdict() {
  jq -s --slurpfile limits "$quick_limits" "[.[] | . as \$r | $quick_values | to_entries[]
      | {row: \$r.row, seed: \$r.seed, what: .key, value,
         limit: \$limits[0].rows[\$r.row][.key].limit}
      | .ok = (if .what == \"in_view_percent\" then .value >= .limit else .value <= .limit end)]" \
    "$measured"/quick/*.json > "$work/checks.json"
  {
    printf 'scene\tseed\twhat\tmeasured\tlimit\n'
    jq -r '.[] | [.row, .seed, .what, (.value * 1000 | round / 1000), .limit,
                  if .ok then "" else "BEYOND ITS LIMIT" end] | @tsv' "$work/checks.json"
  } | awk -F '\t' '{ printf "%-10s %4s  %-16s %9s %9s  %s\n", $1, $2, $3, $4, $5, $6 }'
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
      elif (\$k == \"in_view_percent\") == (\$old.limit > \$new.limit) then \$old else \$new end;
    {
      comment: \"Made by scripts/evaluate --quick-limits: what the seeds gave, and the limits, 4 standard deviations beyond the mean; where an earlier version had a closer one, that.\",
      made: \$made, seeds: \$seeds,
      rows: (group_by(.row) | map(.[0].row as \$row | {key: \$row, value: (map($quick_values) | . as \$all
        | [.[0] | keys_unsorted[]] | map(. as \$k | (\$all | map(.[\$k])) as \$v
          | (\$v | add / length) as \$mean
          | (\$v | map((. - \$mean) * (. - \$mean)) | add / (length - 1) | sqrt) as \$sd
          | (\$v | if \$k == \"in_view_percent\" then min else max end) as \$worst
          | {key: \$k, value: ({mean: \$mean, sd: \$sd, worst: \$worst,
              limit: (if \$k == \"in_view_percent\" then \$mean - 4 * \$sd else \$mean + 4 * \$sd end)}
              | map_values(. * 1000 | round / 1000)
              | closer(\$k; \$before[0].rows[\$row][\$k]; .))}) | from_entries)}) | from_entries)}" \
    "$measured"/quick/*.json | write_json "$quick_limits"
}
