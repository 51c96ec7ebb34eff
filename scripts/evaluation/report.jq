# The tables of docs/results.md from the measured rows. Arguments: $plan (rows.json), $results (all
# measured rows), $recordings (all measured recordings), $long (all measured long runs), $corners (or
# null), $header (text).

# Three digits; two of what is below 0.1.
def digits: if . == null then "–"
  elif . >= 100 then round | tostring
  elif . >= 10 then . * 10 | round / 10 | tostring
  elif . >= 1 then . * 100 | round / 100 | tostring
  elif . >= 0.1 then . * 1000 | round / 1000 | tostring
  elif . > 0 then (1 - (log10 | floor)) as $decimals
    | . * pow(10; $decimals) | round / pow(10; $decimals) | tostring
  else tostring end;
def mm: if . == null then "–" else . * 1000 | digits end;
def cm: if . == null then "–" else . * 100 | digits end;
def percent: if . == null then "–" else . * 1000 | round / 10 | tostring + " %" end;
def fraction(a; b): if a == null or b == null or b == 0 then null else a / b end;
def line: "| " + (map(tostring) | join(" | ")) + " |";
def table($head; $rows): ($head | line), ($head | map("---") | line), ($rows[] | line), "";

def result($name; $seed): first($results[] | select(.row == $name and .seed == $seed)) // null;
def localized: fraction(.stats.localized; .stats.frames);

# The numbers that a result is held against; null when the clean row they hang on is missing.
def target($row; $result):
  if $row.target.clean == null then $row.target
  else result($row.target.clean; $result.seed) as $clean
    | if $clean == null or $clean.final == null then null
      else {ate_mm: ($clean.final.ate_m.mean * 1000 + $row.target.mm),
            ace_mm: ($clean.final.ace_m.mean * 1000 + $row.target.mm),
            localized_percent: (100 * ($clean | localized))} end
  end;
def target_text($t): if $t == null then "clean row missing" else
  "\($t.ate_mm | digits) / \($t.ace_mm | digits), "
  + (if $t.in_view_percent then "\($t.in_view_percent) % in view"
     else "\($t.localized_percent | digits) %" end) end;
def missed($t):
  [ (select(.final.ate_m.mean * 1000 > $t.ate_mm) | "ATE"),
    (select(.final.ace_m.mean * 1000 > $t.ace_mm) | "ACE"),
    (select($t.localized_percent and 100 * localized < $t.localized_percent - 1e-9) | "frames"),
    (select($t.in_view_percent and 100 * .live.in_view.share < $t.in_view_percent) | "frames") ];
def ate_ratio: fraction(.final.ate_m.mean; .final.limit.ate_m.mean);
def ace_ratio: fraction(.final.ace_m.mean; .final.limit.ace_m.mean);
def live_ratio: fraction(.settled.ate_m.mean; .final.ate_m.mean);
def goals_missed:
  [ (select(ate_ratio > 1.2) | "ATE / limit"), (select(ace_ratio > 1.2) | "ACE / limit"),
    (select(live_ratio > 2) | "live / final") ];
def verdict: if length == 0 then "yes" else "**no: \(join(", "))**" end;

# The limit is of markers seen together; between gaps it says nothing.
def held_to_limit($row; f): if $row.gaps then "–" else f end;
def accuracy_row($row):
  if .final == null then [.row, .seed, "0 of \(.stats.frames)"] + [range(9) | "–"] + ["**no: no pose**", "", .made.commit]
  else target($row; .) as $t |
    [ .row, .seed, "\(.stats.localized) of \(.stats.frames)", (.live.in_view.share | percent),
      (.live.ate_m.mean | mm), (.final.ate_m.mean | mm),
      "\(.final.ace_m.mean | mm) (\(.final.common_markers))",
      held_to_limit($row; "\(.final.limit.ate_m.mean | mm) / \(.final.limit.ace_m.mean | mm)"),
      held_to_limit($row; "\(ate_ratio | digits) / \(ace_ratio | digits)"), (live_ratio | digits),
      (.final.limit.corner_rms_px | digits), target_text($t),
      (if $t == null then "–" else missed($t) | verdict end),
      held_to_limit($row; goals_missed | verdict),
      .made.commit ] end;

def main_rows: [$plan.rows[] | select(.target)] ;
def accuracy_table:
  table(["scene", "seed", "frames localized", "of those in view of a mapped marker", "ATE live, mm",
         "ATE final, mm", "ACE, mm (markers)", "limit ATE / ACE, mm", "ours / limit", "live / final",
         "corners, px RMS", "target ATE / ACE, mm, frames", "target met", "goals met", "version"];
    [main_rows[] as $row | ($results | map(select(.row == $row.name)) | sort_by(.seed))
      | if length == 0 then ["\($row.name)", "not measured"] + [range(13) | ""]
        else .[] | accuracy_row($row) end]);

def times($stage): .stats.timing[$stage].cpu_ms | "\(.mean | digits) / \(.p99 | digits) / \(.max | digits)";
def timing_table:
  table(["scene", "seed", "markers", "keyframes", "loops closed", "relocalizations", "t_rel, %",
         "r_rel, deg/25 cm", "detect, ms", "track, ms", "map, ms", "whole frame, ms", "version"];
    [main_rows[] as $row | $results | map(select(.row == $row.name)) | sort_by(.seed)[]
      | [.row, .seed, .stats.markers, .stats.keyframes, .stats.loop_closures,
         .stats.relocalizations, (.live.t_rel_percent | digits),
         (.live.r_rel_deg_per_25cm | digits), times("detect"), times("track"), times("map"),
         times("total"), .made.commit]]);

# FPS1, FPS2 and ACE in metres, as printed in the paper.
def paper_1: {
  "5": {"640x480": [576, 236, 0.034], "800x600": [518, 189, 0.023], "1920x1080": [412, 71, 0.023]},
  "10": {"640x480": [253, 155, 0.021], "800x600": [251, 136, 0.023], "1920x1080": [221, 61, 0.023]},
  "15": {"640x480": [148, 108, 0.021], "800x600": [150, 101, 0.021], "1920x1080": [140, 53, 0.022]}};
def table_1:
  table(["N_c", "image", "FPS without detection: paper", "ours", "FPS with detection: paper", "ours",
         "ACE, mm: paper", "ours", "frames localized", "keyframes", "version"];
    [$plan.rows[] | select(.paper_table_1) | .paper_table_1 as $k
      | paper_1["\($k.nc)"][$k.size] as $p | first($results[] | . as $r | select($r.row == "lab-\($k.size)-nc\($k.nc)")) // null
      | if . == null then [$k.nc, $k.size, $p[0], "not measured", $p[1], "", $p[2] * 1000, "", "", "", ""]
        else [$k.nc, $k.size, $p[0],
          (1000 / (.stats.timing.track.wall_ms.mean + .stats.timing.map.wall_ms.mean) | round),
          $p[1], (1000 / .stats.timing.total.wall_ms.mean | round), $p[2] * 1000,
          (.final.ace_m.mean | mm), (localized | percent), .stats.keyframes, .made.commit] end]);

# ATE in centimetres, t_rel in percent, r_rel in degrees per 25 cm, as printed in the paper.
def paper_2: [["Seq 1", 5.68, 1.42, 0.20, "walls", 1], ["Seq 2", 4.71, 1.60, 0.83, "walls", 2],
  ["Seq 3", 5.90, 1.52, 1.21, "walls", 3], ["Seq 4", 1.64, 0.87, 1.22, "ceiling", 1],
  ["Seq 5", 1.78, 1.24, 1.42, "ceiling", 2], ["Seq 6", 1.64, 1.34, 1.61, "ceiling", 3],
  ["Seq 7", 4.97, 1.35, 1.05, "revisit", 1], ["Seq 8", 6.54, 1.15, 1.23, "revisit", 2]];
def table_2:
  table(["paper's", "ATE, cm", "t_rel, %", "r_rel, deg/25 cm", "ours: scene, seed", "ATE live, cm",
         "ATE final, cm", "t_rel, % (live)", "r_rel, deg/25 cm (live)", "version"];
    [paper_2[] | . as [$name, $ate, $t, $r, $scene, $seed] | result($scene; $seed)
      | [$name, $ate, $t, $r, "\($scene), \($seed)"]
        + if . == null or .final == null then ["not measured", "", "", "", ""]
          else [(.live.ate_m.mean | cm), (.final.ate_m.mean | cm), (.live.t_rel_percent | digits),
                (.live.r_rel_deg_per_25cm | digits), .made.commit] end]);

def corner_table:
  if $corners == null then "Not measured.", ""
  else table(["scene", "corners", "RMS of a coordinate, px", "bias x, px", "bias y, px",
              "bias outward, px", "consistency"];
    [$corners.scenes[] | [.scene, .corners, .rms_px, .bias_x_px, .bias_y_px, .bias_outward_px,
                          .consistency]]), "Version \($corners.made.commit).", "" end;

def long_table:
  table(["run", "frames", "markers", "keyframes", "frames localized", "mean / p99 / longest frame, ms",
         "memory, MB", "ATE, mm", "ACE, mm", "version"];
    [$plan.long[] as $plan | first($long[] | select(.run == $plan.name)) // null
      | if . == null then [$plan.what, "not measured"] + [range(8) | ""]
        else .made.commit as $version | .reports[]
          | [$plan.what, .frames, .markers, .keyframes, "\(.localized_percent | digits) %",
             "\(.mean_ms | digits) / \(.p99_ms | digits) / \(.max_ms | digits)",
             (.resident_mb | digits), (.ate_mm | digits), (.ace_mm | digits), $version] end]);

# What is missed where a value is more than it may be; without a limit nothing is.
def above(value; $limit; $what):
  if $limit == null then empty elif value == null then "\($what) not measured"
  elif value > $limit then $what else empty end;
def gap_missed($t):
  [ (select(.ends.gaps == 0) | "no gap"),
    (select(.ends.lost > 0) | "\(.ends.lost) of \(.ends.gaps) gaps lost"),
    above(.ends.from_marker_mm.worst; $t.end_mm; "end"),
    above(.ends.turn_from_marker_deg.worst; $t.end_deg; "turn"),
    above(.ends.jump_mm.worst; $t.jump_mm; "jump"),
    above(.ends.share_percent.worst; $t.share_percent; "share"),
    above(.beyond_3_sigma_position_longest_s; $t.beyond_s; "beyond 3 sigma"),
    (select($t.first_way) | above(if .markers.mapped_first_way then .markers.all - .markers.mapped_first_way else null end;
                                  0; "markers after the first way")),
    (select($t.distance_mm) | above(.markers.all - .markers.mapped; 0; "markers")),
    above(.distance_off_mm.worst; $t.distance_mm; "distance") ];
def gap_target:
  [ (.end_mm | select(.) | "end <= \(.) mm"), (.end_deg | select(.) | "end <= \(.) degrees"),
    (.jump_mm | select(.) | "jump <= \(.) mm"), (.share_percent | select(.) | "end <= \(.) %"),
    (.beyond_s | select(.) | "beyond 3 sigma <= \(.) s"),
    (.first_way | select(.) | "all markers after the first way"),
    (.distance_mm | select(.) | "farthest two <= \(.) mm") ] | join(", ");
def three($times): $times | "\(.mean | digits) / \(.p99 | digits) / \(.worst | digits)";
def two($errors): $errors | "\(.rms | digits) / \(.worst | digits)";
def gap_table:
  table(["scene", "gaps", "way, m", "off at the end, mm: rms / worst", "degrees: rms / worst", "of the way: rms / worst",
         "scale: rms / told at most", "jump, mm: rms / worst", "NEES at 1 / 2 / 5 / 10 s", "frames with a pose", "NEES above 54",
         "longest beyond 3 sigma, s", "markers in the map: after the first way / at the end of all",
         "farthest two off, mm: rms / worst", "mean / p99 / longest frame, ms", "natural features of it, ms",
         "target", "met", "version"];
    [$plan.gaps[] as $plan | first($gaps[] | select(.run == $plan.name)) // null
      | if . == null then [$plan.what, "not measured"] + [range(17) | ""] else
        .made.commit as $version | .report
          | [$plan.what, "\(.ends.gaps), \(.ends.lost) lost", (.ends.way_m | digits),
             two(.ends.from_marker_mm), two(.ends.turn_from_marker_deg), two(.ends.share_percent) + " %",
             "\(.ends.scale_percent.rms | digits) / \(.ends.scale_percent.told | digits) %",
             two(.ends.jump_mm), ([.into[].nees | digits] | join(" / ")), "\(.posed_percent | digits) %",
             "\(.beyond_3_sigma_percent | digits) %", (.beyond_3_sigma_position_longest_s | digits),
             "\(.markers.mapped_first_way // "–") / \(.markers.mapped) of \(.markers.all)", two(.distance_off_mm),
             three(.cpu_ms), three(.features_ms), ($plan.target // {} | gap_target),
             (if $plan.target then gap_missed($plan.target) | verdict else "" end), $version] end]);

def target_missed($t): [.seeds[] | select((.during_px.mean // 1e9) > $t) | "mean"] | unique;
def by_seed(f): [.seeds[] | f | if . then digits else "none" end] | join(", ");
def target_table:
  table(["natural marker", "from, m", "frames with a pose, by seed", "before the table: mean, px", "standard deviation, px",
         "worst, px", "all frames: mean, px", "worst, px", "target", "met", "version"];
    [$plan.targets[] as $plan | first($targets[] | select(.name == $plan.name)) // null
      | if . == null then [$plan.name, "not measured"] + [range(9) | ""] else
        [.name, $plan.far_m, ([.seeds[] | "\(.posed) of \(.frames)"] | join(", ")),
         by_seed(.during_px.mean), by_seed(.during_px.deviation), by_seed(.during_px.worst),
         by_seed(.px.mean), by_seed(.px.worst),
         "mean <= \($plan.target_px)", (target_missed($plan.target_px) | verdict), .made.commit] end]);

def by_constraint_seed(f): [.seeds[] | f | digits] | join(", ");
def signed: if . < 0 then "-" + (-. | digits) else digits end;
def constraint_table:
  table(["corridor", "known of its markers", "drift live, mm, by seed", "drift final, mm, by seed", "along, out, up, mm, by seed",
         "told, mm, by seed", "NEES, by seed", "version"];
    [$plan.constraints[] as $plan | first($constraints[] | select(.run == $plan.name)) // null
      | if . == null then [$plan.what, "not measured"] + [range(6) | ""] else
        .made.commit as $commit | .known[]
        | [$plan.what, .known, by_constraint_seed(.live.distance_mm), by_constraint_seed(.final.distance_mm),
           ([.seeds[].final | "\(.along_mm | signed) \(.out_mm | signed) \(.up_mm | signed)"] | join(", ")),
           by_constraint_seed(.final.sigma_mm), by_constraint_seed(.final.nees), $commit] end]);

def building_table:
  table(["frames", "seed", "with a pose", "with a marker in view", "pieces: begun / left", "markers", "ATE final, mm", "ACE, mm",
         "limit ATE / ACE, mm", "version"];
    [$plan.buildings[] as $plan | first($buildings[] | select(.run == $plan.name)) // null
      | if . == null then [$plan.what, "not measured"] + [range(8) | ""] else
        .made.commit as $commit | .seeds[]
        | [$plan.what, .seed, "\(.localized) of \(.frames)", "\(.live.in_view.localised) of \(.live.in_view.frames)",
           "\(1 + .begun) / \(.final.pieces | length)", .markers, (.final.ate_m.mean | mm), (.final.ace_m.mean | mm),
           "\(.final.limit.ate_m.mean | mm) / \(.final.limit.ace_m.mean | mm)", $commit] end]);

def join_table:
  table(["halls", "markers of each", "keyframes: stays / comes in", "frames with a pose while joining", "before: mean / p99 / longest frame, ms",
         "joining, ms", "after, ms", "version"];
    [$plan.joins[] as $plan | first($joins[] | select(.run == $plan.name)) // null
      | if . == null then [$plan.what, "not measured"] + [range(6) | ""] else
        .made.commit as $commit | .sizes[]
        | [.phases[] | "\(.mean_ms | digits) / \(.p99_ms | digits) / \(.max_ms | digits)"] as $times
        | [$plan.what, .markers_each, (.keyframes | join(" / ")), "\(.phases[1].with_pose) of \(.phases[1].frames)"]
          + $times + [$commit] end]);

def recording_missed($t):
  [ (select($t.markers and .stats.markers < $t.markers) | "markers"),
    (select($t.rms_px and .map_rms_px == null) | "RMS not measured"),
    (select($t.rms_px and .map_rms_px != null and .map_rms_px >= $t.rms_px) | "RMS"),
    (select($t.ace_mm and (.truth.ace_m.mean // 1e9) * 1000 > $t.ace_mm) | "ACE"),
    (select($t.agreement_mm and (.other.ace_m.max // 1e9) * 1000 > $t.agreement_mm) | "agreement") ];
def recording_table:
  table(["recording", "frames localized", "markers", "reprojection RMS, px: live / map", "ACE, mm: mean / max",
         "ACE limit, mm", "ATE final, mm", "map against the other order's, cm: mean / max", "target", "met", "version"];
    [$plan.recordings[] as $plan | first($recordings[] | select(.recording == $plan.name)) // null
      | if . == null then [$plan.name, "not measured"] + [range(9) | ""] else
        [.recording, "\(.stats.localized) of \(.stats.frames)", .stats.markers,
         "\(.stats.reprojection_rms_px | digits) / \(if .map_rms_px then .map_rms_px | digits else "not measured" end)",
         (if .truth.ace_m then "\(.truth.ace_m.mean | mm) / \(.truth.ace_m.max | mm)" else "" end),
         (if .truth.limit.ace_m then .truth.limit.ace_m.mean | mm else "" end),
         (if .truth.ate_m then .truth.ate_m.mean | mm else "" end),
         (if .other.ace_m then "\(.other.ace_m.mean | cm) / \(.other.ace_m.max | cm)" else "" end),
         ($plan.target // {} | [(.markers | select(.) | "\(.) markers"), (.rms_px | select(.) | "RMS < \(.) px"),
            (.ace_mm | select(.) | "ACE <= \(.) mm"), (.agreement_mm | select(.) | "max <= \(. / 10) cm")] | join(", ")),
         (if $plan.target then recording_missed($plan.target) | verdict else "" end), .made.commit] end]);

# A recording of a building: its pieces, each aligned by itself.
def in_pieces_missed($t):
  [ (select(.stats.localized < $t.localized_share * .frames_with_marker) | "frames"),
    (select(.stats.markers < $t.markers) | "markers"),
    (select((.truth.pieces | length) > $t.pieces) | "pieces"),
    (select(any(.truth.pieces[]; .ace_m.mean * 1000 > $t.piece_ace_mm)) | "ACE") ];
def in_pieces_table:
  table(["recording", "with a pose, of frames with a marker", "markers", "quarantined", "ACE by piece, mm (markers)", "focal length px (sigma, %)",
         "limit of the corners, ACE, mm", "target", "met", "version"];
    [$plan.in_pieces[] as $plan | first($recordings[] | select(.recording == $plan.name)) // null
      | if . == null then [$plan.what, "not measured"] + [range(8) | ""] else
        [$plan.what, "\(.stats.localized) of \(.frames_with_marker)", .stats.markers, .stats.counters.quarantined_markers,
         ([.truth.pieces[] | "\(.ace_m.mean | mm) (\(.markers))"] | join(", ")),
         "\(.stats.lens.fx | digits) (\(.stats.lens.focal_sigma_percent // "as given" | if type == "number" then digits else . end))",
         (if .truth.limit.ace_m then .truth.limit.ace_m.mean | mm else "" end),
         ($plan.target | "\(100 * .localized_share) % of them, \(.markers) markers, <= \(.pieces) pieces, each <= \(.piece_ace_mm) mm"),
         (in_pieces_missed($plan.target) | verdict), .made.commit] end]);

$header,
"",
"## Simulated sequences, exact truth",
"",
$text.accuracy, "", accuracy_table,
"### Relative errors and time",
"",
$text.timing, "", timing_table,
"## The paper's table 1: keyframes per marker and image size",
"",
$text.table_1, "", table_1,
"## The paper's table 2",
"",
$text.table_2, "", table_2,
"## Corners",
"",
$text.corners, "", corner_table,
"## Very many frames, very many markers",
"",
$text.long, "", long_table,
"## What is known of markers",
"",
$text.constraints, "", constraint_table,
"## A building in pieces",
"",
$text.buildings, "", building_table,
"### Two pieces become one",
"",
$text.joins, "", join_table,
"## Between markers",
"",
$text.gaps, "", gap_table,
"### Targets from natural markers",
"",
$text.targets, "", target_table,
"## Real recordings",
"",
$text.recordings, "", recording_table,
"### A building at two frames a second",
"",
$text.in_pieces, "", in_pieces_table
