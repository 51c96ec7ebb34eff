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

io::Json times(std::vector<double> times_ms) {
  std::ranges::sort(times_ms);
  const std::size_t frames = times_ms.size();
  return {{"mean", mean(times_ms)},
          {"p99", frames == 0 ? 0.0 : times_ms[frames * 99 / 100]},
          {"worst", frames == 0 ? 0.0 : times_ms.back()}};
}

// Null where no way was long enough.
class Scales {
 public:
  void add(const std::optional<Scale>& scale) {
    if (!scale) return;
    errors_.push_back(1e2 * scale->error);
    sigmas_.push_back(1e2 * scale->sigma);
  }
  [[nodiscard]] io::Json percent() const {
    if (errors_.empty()) return nullptr;
    return {{"rms", rms(errors_)}, {"worst", largestSize(errors_)}, {"told", rms(sigmas_)}};
  }

 private:
  std::vector<double> errors_, sigmas_;
};

io::Json intoGaps(const std::vector<Gap>& gaps, std::size_t at) {
  std::vector<double> errors, from_marker, sigmas, nees;
  Scales scales;
  for (const Gap& gap : gaps) {
    if (!gap.into[at]) continue;
    errors.push_back(1e3 * gap.into[at]->error_m);
    from_marker.push_back(1e3 * gap.into[at]->from_marker_m);
    sigmas.push_back(1e3 * gap.into[at]->sigma_m);
    nees.push_back(gap.into[at]->nees);
    scales.add(gap.into[at]->scale);
  }
  // The sum over n gaps of a quantity of 6 dimensions has 6n degrees of freedom.
  const double band =
      1.96 * std::sqrt(12.0 / static_cast<double>(std::max<std::size_t>(nees.size(), 1)));
  return {{"seconds", kInto_s[at]},     {"gaps", errors.size()},
          {"error_mm", spread(errors)}, {"from_marker_mm", spread(from_marker)},
          {"sigma_mm", rms(sigmas)},    {"scale_percent", scales.percent()},
          {"nees", mean(nees)},         {"nees_band", {6.0 - band, 6.0 + band}}};
}

io::Json endsOf(const std::vector<Gap>& gaps) {
  std::vector<double> errors, from_marker, turns, shares, jumps, ways;
  Scales scales;
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
    scales.add(gap.last->scale);
    if (gap.jump_m) jumps.push_back(1e3 * *gap.jump_m);
  }
  return {{"gaps", gaps.size()},
          {"lost", lost},
          {"way_m", mean(ways)},
          {"error_mm", spread(errors)},
          {"from_marker_mm", spread(from_marker)},
          {"turn_from_marker_deg", spread(turns)},
          {"share_percent", spread(shares)},
          {"scale_percent", scales.percent()},
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
    if (gap.last->scale) {
      line["scale_percent"] = 1e2 * gap.last->scale->error;
      line["scale_sigma_percent"] = 1e2 * gap.last->scale->sigma;
    }
  }
  if (gap.jump_m) line["jump_mm"] = 1e3 * *gap.jump_m;
  return line;
}

double longest_s(const std::vector<Beyond>& stretches) {
  double longest = 0.0;
  for (const Beyond& b : stretches) longest = std::max(longest, b.end_s - b.begin_s);
  return longest;
}

io::Json each(const std::vector<Beyond>& stretches) {
  io::Json list = io::Json::array();
  for (const Beyond& beyond : stretches) {
    list.push_back({{"begin_s", beyond.begin_s},
                    {"end_s", beyond.end_s},
                    {"worst_mm", 1e3 * beyond.worst_m},
                    {"by_markers", beyond.by_markers}});
  }
  return list;
}

double number(const io::Json& json, const char* a, const char* b) {
  return json.at(a).at(b).get<double>();
}
double number(const io::Json& json, const char* a) { return json.at(a).get<double>(); }

void printScale(const io::Json& scale_percent) {
  if (scale_percent.is_null()) return;
  std::printf("; scale %.2f %% rms, told at most %.2f", number(scale_percent, "rms"),
              number(scale_percent, "told"));
}

void printGap(const Gap& gap) {
  std::printf("    %.2f to %.2f s, %.2f m: %d of %d frames", gap.begin_s, gap.end_s, gap.way_m,
              gap.posed, gap.frames);
  if (gap.last) {
    std::printf(", error %.1f mm, from the marker %.1f, sigma %.1f, NEES %.1f",
                1e3 * gap.last->error_m, 1e3 * gap.last->from_marker_m, 1e3 * gap.last->sigma_m,
                gap.last->nees);
    if (const auto& scale = gap.last->scale) {
      std::printf(", scale %.2f %%, told at most %.2f", 1e2 * scale->error, 1e2 * scale->sigma);
    }
  }
  if (gap.jump_m) std::printf(", jump %.1f mm", 1e3 * *gap.jump_m);
  std::printf("\n");
}

void printBeyond(const char* what, const std::vector<Beyond>& stretches) {
  for (const Beyond& beyond : stretches) {
    std::printf("    %s from %.2f to %.2f s, at worst %.1f mm off%s\n", what, beyond.begin_s,
                beyond.end_s, 1e3 * beyond.worst_m, beyond.by_markers ? ", by markers" : "");
  }
}

template <typename Value>
void append(const std::vector<Value>& values, std::vector<Value>* to) {
  to->insert(to->end(), values.begin(), values.end());
}

}  // namespace

void GapReport::add(const GapReport& run) {
  append(run.gaps, &gaps);
  append(run.cpu_ms, &cpu_ms);
  append(run.features_ms, &features_ms);
  frames += run.frames;
  posed += run.posed;
  beyond_3_sigma += run.beyond_3_sigma;
  append(run.beyond, &beyond);
  append(run.beyond_position, &beyond_position);
  append(run.distance_errors_mm, &distance_errors_mm);
  mapped_first_way += run.mapped_first_way;
  mapped += run.mapped;
  markers += run.markers;
}

io::Json summaryOf(const std::string& scene, GapReport report) {
  const auto percent = [&](int count) { return 1e2 * count / std::max(1, report.frames); };
  io::Json summary = {
      {"scene", scene},
      {"frames", report.cpu_ms.size()},
      {"posed_percent", percent(report.posed)},
      {"beyond_3_sigma_percent", percent(report.beyond_3_sigma)},
      {"beyond_3_sigma_longest_s", longest_s(report.beyond)},
      {"beyond_3_sigma_position_longest_s", longest_s(report.beyond_position)},
      {"cpu_ms", times(std::move(report.cpu_ms))},
      {"features_ms", times(std::move(report.features_ms))},
      {"into", io::Json::array()},
      {"ends", endsOf(report.gaps)},
      {"markers",
       {{"mapped_first_way", report.mapped_first_way},
        {"mapped", report.mapped},
        {"all", report.markers}}},
      {"distance_off_mm", spread(report.distance_errors_mm)},
      {"each", io::Json::array()},
      {"beyond", each(report.beyond)},
      {"beyond_position", each(report.beyond_position)},
  };
  for (std::size_t i = 0; i < kInto_s.size(); ++i) {
    io::Json into = intoGaps(report.gaps, i);
    if (into.at("gaps") != 0) summary["into"].push_back(std::move(into));
  }
  for (const Gap& gap : report.gaps) summary["each"].push_back(each(gap));
  return summary;
}

void print(const io::Json& summary) {
  std::printf(
      "%s: %d frames, a pose in %.2f %% since the first one, NEES above 54 in %.2f %%, for "
      "%.2f s at most, position beyond 3 sigma for %.2f s at most; %.2f ms a frame, p99 %.2f, "
      "worst %.2f; of that natural features %.2f, p99 %.2f, worst %.2f\n",
      summary.at("scene").get<std::string>().c_str(), summary.at("frames").get<int>(),
      number(summary, "posed_percent"), number(summary, "beyond_3_sigma_percent"),
      number(summary, "beyond_3_sigma_longest_s"),
      number(summary, "beyond_3_sigma_position_longest_s"), number(summary, "cpu_ms", "mean"),
      number(summary, "cpu_ms", "p99"), number(summary, "cpu_ms", "worst"),
      number(summary, "features_ms", "mean"), number(summary, "features_ms", "p99"),
      number(summary, "features_ms", "worst"));
  for (const io::Json& into : summary.at("into")) {
    std::printf(
        "  %4.0f s into %3d gaps: error %6.1f mm rms, worst %6.1f, sigma %6.1f; from the marker "
        "%.1f; NEES %5.2f (95 %% of 6: %.2f to %.2f)",
        number(into, "seconds"), into.at("gaps").get<int>(), number(into, "error_mm", "rms"),
        number(into, "error_mm", "worst"), number(into, "sigma_mm"),
        number(into, "from_marker_mm", "rms"), number(into, "nees"),
        into.at("nees_band")[0].get<double>(), into.at("nees_band")[1].get<double>());
    printScale(into.at("scale_percent"));
    std::printf("\n");
  }
  const io::Json& ends = summary.at("ends");
  if (ends.at("gaps") != 0) {
    std::printf(
        "  ends: error %.1f mm rms, worst %.1f; from the marker %.1f, worst %.1f, of %.2f m (%.2f "
        "%% rms, worst %.2f), and %.2f degrees, worst %.2f",
        number(ends, "error_mm", "rms"), number(ends, "error_mm", "worst"),
        number(ends, "from_marker_mm", "rms"), number(ends, "from_marker_mm", "worst"),
        number(ends, "way_m"), number(ends, "share_percent", "rms"),
        number(ends, "share_percent", "worst"), number(ends, "turn_from_marker_deg", "rms"),
        number(ends, "turn_from_marker_deg", "worst"));
    printScale(ends.at("scale_percent"));
    std::printf("; jump %.1f mm rms, worst %.1f; lost before the end: %d of %d\n",
                number(ends, "jump_mm", "rms"), number(ends, "jump_mm", "worst"),
                ends.at("lost").get<int>(), ends.at("gaps").get<int>());
  }
  const io::Json& markers = summary.at("markers");
  std::printf(
      "  live maps: %d of %d markers, %d after the first way; distance of the farthest two off by "
      "%.1f mm rms, worst %.1f\n",
      markers.at("mapped").get<int>(), markers.at("all").get<int>(),
      markers.at("mapped_first_way").get<int>(), number(summary, "distance_off_mm", "rms"),
      number(summary, "distance_off_mm", "worst"));
  std::fflush(stdout);
}

void printRun(const std::string& scene, std::uint64_t seed, const GapReport& run) {
  std::printf(
      "  %s, seed %llu: %d of %d frames have a pose since the first one, %zu gaps, %d of "
      "%d markers\n",
      scene.c_str(), static_cast<unsigned long long>(seed), run.posed, run.frames, run.gaps.size(),
      run.mapped, run.markers);
  for (const Gap& gap : run.gaps) printGap(gap);
  printBeyond("NEES above 54", run.beyond);
  printBeyond("position beyond 3 sigma", run.beyond_position);
  std::fflush(stdout);
}

}  // namespace waymark::bench
