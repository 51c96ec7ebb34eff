#include "tests/bench/gap_report.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <utility>

namespace waymark::bench {
namespace {

double mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return values.empty() ? 0.0 : sum / static_cast<double>(values.size());
}

double rms(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value * value;
  return values.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(values.size()));
}

double largestSize(const std::vector<double>& values) {
  double largest = 0.0;
  for (const double value : values) largest = std::max(largest, std::abs(value));
  return largest;
}

io::Json spread(const std::vector<double>& values) {
  return {{"rms", rms(values)}, {"worst", largestSize(values)}};
}

io::Json intoGaps(const std::vector<Gap>& gaps, std::size_t at) {
  std::vector<double> errors, from_marker, sigmas, nees;
  for (const Gap& gap : gaps) {
    if (!gap.into[at]) continue;
    errors.push_back(1e3 * gap.into[at]->error_m);
    from_marker.push_back(1e3 * gap.into[at]->from_marker_m);
    sigmas.push_back(1e3 * gap.into[at]->sigma_m);
    nees.push_back(gap.into[at]->nees);
  }
  // The sum over n gaps of a quantity of 6 dimensions has 6n degrees of freedom.
  const double band =
      1.96 * std::sqrt(12.0 / static_cast<double>(std::max<std::size_t>(nees.size(), 1)));
  return {{"seconds", kInto_s[at]},
          {"gaps", errors.size()},
          {"error_mm", spread(errors)},
          {"from_marker_mm", spread(from_marker)},
          {"sigma_mm", rms(sigmas)},
          {"nees", mean(nees)},
          {"nees_band", {6.0 - band, 6.0 + band}}};
}

io::Json endsOf(const std::vector<Gap>& gaps) {
  std::vector<double> errors, from_marker, turns, shares, jumps, scales, ways;
  int lost = 0;
  for (const Gap& gap : gaps) {
    ways.push_back(gap.way_m);
    if (!gap.last) {
      ++lost;
      continue;
    }
    errors.push_back(1e3 * gap.last->error_m);
    from_marker.push_back(1e3 * gap.last->from_marker_m);
    turns.push_back(gap.last->turn_from_marker_deg);
    if (gap.way_m > 0.1) shares.push_back(1e2 * gap.last->from_marker_m / gap.way_m);
    scales.push_back(1e2 * gap.scale);
    if (gap.jump_m) jumps.push_back(1e3 * *gap.jump_m);
  }
  return {{"gaps", gaps.size()},
          {"lost", lost},
          {"way_m", mean(ways)},
          {"error_mm", spread(errors)},
          {"from_marker_mm", spread(from_marker)},
          {"turn_from_marker_deg", spread(turns)},
          {"share_percent", spread(shares)},
          {"scale_percent", spread(scales)},
          {"jump_mm", spread(jumps)}};
}

io::Json each(const Gap& gap) {
  io::Json line = {{"begin_s", gap.begin_s},
                   {"end_s", gap.end_s},
                   {"way_m", gap.way_m},
                   {"posed", gap.posed},
                   {"frames", gap.frames}};
  if (gap.last) {
    line["error_mm"] = 1e3 * gap.last->error_m;
    line["from_marker_mm"] = 1e3 * gap.last->from_marker_m;
    line["sigma_mm"] = 1e3 * gap.last->sigma_m;
    line["nees"] = gap.last->nees;
    line["scale_percent"] = 1e2 * gap.scale;
  }
  if (gap.jump_m) line["jump_mm"] = 1e3 * *gap.jump_m;
  return line;
}

double longest_s(const std::vector<Beyond>& stretches) {
  double longest = 0.0;
  for (const Beyond& b : stretches) longest = std::max(longest, b.end_s - b.begin_s);
  return longest;
}

io::Json each(const Beyond& beyond) {
  return {{"begin_s", beyond.begin_s},
          {"end_s", beyond.end_s},
          {"worst_mm", 1e3 * beyond.worst_m},
          {"by_markers", beyond.by_markers}};
}

double number(const io::Json& json, const char* a, const char* b) {
  return json.at(a).at(b).get<double>();
}
double number(const io::Json& json, const char* a) { return json.at(a).get<double>(); }

void printEach(const io::Json& gap) {
  std::printf("    %.2f to %.2f s, %.2f m: %d of %d frames", number(gap, "begin_s"),
              number(gap, "end_s"), number(gap, "way_m"), gap.at("posed").get<int>(),
              gap.at("frames").get<int>());
  if (gap.contains("error_mm")) {
    std::printf(", error %.1f mm, from the marker %.1f, sigma %.1f, NEES %.1f, scale %.2f %%",
                number(gap, "error_mm"), number(gap, "from_marker_mm"), number(gap, "sigma_mm"),
                number(gap, "nees"), number(gap, "scale_percent"));
  }
  if (gap.contains("jump_mm")) std::printf(", jump %.1f mm", number(gap, "jump_mm"));
  std::printf("\n");
}

}  // namespace

io::Json summaryOf(const std::string& scene, GapReport report) {
  std::ranges::sort(report.cpu_ms);
  const std::size_t frames = report.cpu_ms.size();
  const auto percent = [&](int count) { return 1e2 * count / std::max(1, report.frames); };
  io::Json summary = {
      {"scene", scene},
      {"frames", frames},
      {"posed_percent", percent(report.posed)},
      {"beyond_3_sigma_percent", percent(report.beyond_3_sigma)},
      {"beyond_3_sigma_longest_s", longest_s(report.beyond)},
      {"cpu_ms",
       {{"mean", mean(report.cpu_ms)},
        {"p99", frames == 0 ? 0.0 : report.cpu_ms[frames * 99 / 100]},
        {"worst", frames == 0 ? 0.0 : report.cpu_ms.back()}}},
      {"into", io::Json::array()},
      {"ends", endsOf(report.gaps)},
      {"markers", {{"mapped", report.mapped}, {"all", report.markers}}},
      {"distance_off_mm", spread(report.distance_errors_mm)},
      {"each", io::Json::array()},
      {"beyond", io::Json::array()},
  };
  for (std::size_t i = 0; i < kInto_s.size(); ++i) {
    io::Json into = intoGaps(report.gaps, i);
    if (into.at("gaps") != 0) summary["into"].push_back(std::move(into));
  }
  for (const Gap& gap : report.gaps) summary["each"].push_back(each(gap));
  for (const Beyond& beyond : report.beyond) summary["beyond"].push_back(each(beyond));
  return summary;
}

void print(const io::Json& summary, bool every_gap) {
  std::printf(
      "%s: %d frames, a pose in %.2f %% since the first one, NEES above 54 in %.2f %%, for "
      "%.2f s at most; %.2f ms a frame, p99 %.2f, worst %.2f\n",
      summary.at("scene").get<std::string>().c_str(), summary.at("frames").get<int>(),
      number(summary, "posed_percent"), number(summary, "beyond_3_sigma_percent"),
      number(summary, "beyond_3_sigma_longest_s"), number(summary, "cpu_ms", "mean"),
      number(summary, "cpu_ms", "p99"), number(summary, "cpu_ms", "worst"));
  for (const io::Json& into : summary.at("into")) {
    std::printf(
        "  %4.0f s into %3d gaps: error %6.1f mm rms, worst %6.1f, sigma %6.1f; from the marker "
        "%.1f; NEES %5.2f (95 %% of 6: %.2f to %.2f)\n",
        number(into, "seconds"), into.at("gaps").get<int>(), number(into, "error_mm", "rms"),
        number(into, "error_mm", "worst"), number(into, "sigma_mm"),
        number(into, "from_marker_mm", "rms"), number(into, "nees"),
        into.at("nees_band")[0].get<double>(), into.at("nees_band")[1].get<double>());
  }
  const io::Json& ends = summary.at("ends");
  if (ends.at("gaps") != 0) {
    std::printf(
        "  ends: error %.1f mm rms, worst %.1f; from the marker %.1f, worst %.1f, of %.2f m (%.2f "
        "%% rms, worst %.2f), and %.2f degrees, worst %.2f; scale %.2f %% rms; jump %.1f mm rms, "
        "worst %.1f; lost before the end: %d of %d\n",
        number(ends, "error_mm", "rms"), number(ends, "error_mm", "worst"),
        number(ends, "from_marker_mm", "rms"), number(ends, "from_marker_mm", "worst"),
        number(ends, "way_m"), number(ends, "share_percent", "rms"),
        number(ends, "share_percent", "worst"), number(ends, "turn_from_marker_deg", "rms"),
        number(ends, "turn_from_marker_deg", "worst"), number(ends, "scale_percent", "rms"),
        number(ends, "jump_mm", "rms"), number(ends, "jump_mm", "worst"),
        ends.at("lost").get<int>(), ends.at("gaps").get<int>());
  }
  std::printf(
      "  live maps: %d of %d markers, distance of the farthest two off by %.1f mm rms, worst "
      "%.1f\n",
      summary.at("markers").at("mapped").get<int>(), summary.at("markers").at("all").get<int>(),
      number(summary, "distance_off_mm", "rms"), number(summary, "distance_off_mm", "worst"));
  for (const io::Json& gap : summary.at("each")) {
    if (every_gap) printEach(gap);
  }
  for (const io::Json& beyond : summary.at("beyond")) {
    if (!every_gap) break;
    std::printf("    beyond 3 sigma from %.2f to %.2f s, at worst %.1f mm off%s\n",
                number(beyond, "begin_s"), number(beyond, "end_s"), number(beyond, "worst_mm"),
                beyond.at("by_markers").get<bool>() ? ", by markers" : "");
  }
  std::fflush(stdout);
}

}  // namespace waymark::bench
