#include "tools/diagnosis/source_report.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "base/quantile.h"
#include "io/text/number_text.h"

namespace waymark::diagnosis {
namespace {

using io::fixed;
using Level = Finding::Level;

std::string padded(std::string_view text, std::size_t width) {
  return std::string(text) + std::string(text.size() < width ? width - text.size() : 1, ' ');
}

}  // namespace

Finding timesFinding(std::span<const std::int64_t> times_ns, double nominal_hz) {
  constexpr double kUneven = 0.25;     // of a period, 95 % of the steps are within it
  constexpr double kLongestGap = 1.9;  // periods: a frame is missing
  constexpr double kSlow = 0.8;        // of the promised rate
  if (times_ns.size() < 3) return {Level::kNote, "times", "too few frames to tell"};
  std::vector<double> steps_s;
  for (std::size_t i = 1; i < times_ns.size(); ++i) {
    steps_s.push_back(1e-9 * static_cast<double>(times_ns[i] - times_ns[i - 1]));
  }
  std::vector<double> sorted = steps_s;
  std::ranges::sort(sorted);
  const double period_s = quantile(std::span<const double>(sorted), 500);
  if (!(sorted.front() > 0.0)) {
    return {Level::kBad, "times", "two frames have the same time, or an earlier one than before"};
  }
  std::vector<double> off_s;
  for (const double step : steps_s) off_s.push_back(std::abs(step - period_s));
  std::ranges::sort(off_s);
  const double jitter_s = quantile(std::span<const double>(off_s), 950);
  const double rate_hz = 1.0 / period_s;
  const auto gaps =
      std::ranges::count_if(steps_s, [&](double step) { return step > kLongestGap * period_s; });
  Finding finding{Level::kGood, "times",
                  std::to_string(times_ns.size()) + " frames at " + fixed(rate_hz, 1) +
                      " Hz, 95 % within " + fixed(1e3 * jitter_s, 1) + " ms of it"};
  if (gaps > 0) {
    finding.level = Level::kNote;
    finding.text += "; " + std::to_string(gaps) + " gaps, the longest of " +
                    fixed(1e3 * sorted.back(), 0) + " ms: frames are lost on the way";
  }
  if (jitter_s > kUneven * period_s) {
    finding.level = Level::kNote;
    finding.text += "; uneven: are the times those of arrival, or is the exposure automatic?";
  }
  if (nominal_hz > 0.0 && rate_hz < kSlow * nominal_hz) {
    finding.level = Level::kNote;
    finding.text += "; " + fixed(nominal_hz, 0) +
                    " Hz are promised: a long exposure in the dark makes cameras slower";
  }
  return finding;
}

std::vector<Finding> qualityFindings(const ImageQuality& quality) {
  const QualityLimits limits;
  QualityLimits light_only = limits;
  light_only.wide_edges_px = 1e9;
  const std::vector<std::string> light = qualityAdvice(quality, light_only);
  const std::vector<std::string> all = qualityAdvice(quality, limits);
  std::vector<Finding> findings;
  findings.push_back({light.empty() ? Level::kGood : Level::kBad, "light",
                      light.empty() ? "grey levels " + std::to_string(quality.dark) + " to " +
                                          std::to_string(quality.bright) + ", half below " +
                                          std::to_string(quality.median)
                                    : light.front()});
  const bool blurred = all.size() > light.size();
  std::string focus = "nothing with an edge that could tell";
  if (quality.edge_width_px > 0.0) {
    focus = "the sharpest edges are " + fixed(quality.edge_width_px, 1) + " pixels wide";
  }
  findings.push_back(
      {blurred ? Level::kBad : (quality.edge_width_px > 0.0 ? Level::kGood : Level::kNote), "focus",
       blurred ? all.back() : focus});
  return findings;
}

std::vector<Finding> familyFindings(std::span<const FamilyCount> families, const OddImages& odd,
                                    std::size_t images, const std::string& asked) {
  std::vector<Finding> findings;
  for (const FamilyCount& family : families) {
    Finding found{Level::kGood, "markers",
                  family.dictionary + ": " + std::to_string(family.markers) + " in " +
                      std::to_string(family.images) + " of " + std::to_string(images) +
                      " images, ids " + idList(family.ids) + "; " +
                      fixed(family.median_side_px, 0) + " pixels a side"};
    if (!asked.empty() && family.dictionary != asked && &family == &families.front()) {
      found.level = Level::kBad;
      found.text += "; asked for was " + asked;
    } else if (&family != &families.front()) {
      found.level = Level::kNote;
    }
    findings.push_back(std::move(found));
  }
  if (!families.empty()) return findings;
  if (odd.mirrored) {
    return {{Level::kBad, "markers",
             "the images are mirrored: turned left to right they have markers of " +
                 odd.mirrored->dictionary}};
  }
  if (odd.inverted) {
    return {{Level::kBad, "markers",
             "the markers are white on black, of " + odd.inverted->dictionary +
                 ": print them black on white"}};
  }
  return {{Level::kBad, "markers", "none of any family in " + std::to_string(images) + " images"}};
}

Finding motionFinding(std::vector<double> steps_px) {
  constexpr double kFast_px = 40.0;
  if (steps_px.empty())
    return {Level::kNote, "motion", "no marker in two frames one after the other"};
  std::ranges::sort(steps_px);
  const std::span<const double> sorted = steps_px;
  const double often = quantile(sorted, 900);
  Finding finding{Level::kGood, "motion",
                  "markers move by " + fixed(quantile(sorted, 500), 1) +
                      " pixels from frame to frame, 90 % by less than " + fixed(often, 0)};
  if (often > kFast_px) {
    finding.level = Level::kNote;
    finding.text += ": fast; more frames a second, or a shorter exposure, keep it sharp";
  }
  return finding;
}

Finding lensFinding(const std::string& file, const slam::LensKnowledge& known, double focal_px) {
  const std::string focal = "focal length " + fixed(focal_px, 1) + " px";
  const bool as_given = known.state == slam::LensState::kGiven;
  if (!file.empty()) {
    if (as_given) return {Level::kGood, "lens", file + " fits, as far as markers show; " + focal};
    if (known.refines_given)
      return {Level::kGood, "lens", file + " " + refinedText(known, focal_px)};
    return {Level::kBad, "lens", file + " " + misfitText(known, focal_px)};
  }
  const std::string what_helps = kWhatTeachesALens;
  if (as_given) {
    return {Level::kNote, "lens", "no calibration, and too little to learn it: " + what_helps};
  }
  const std::string how_well = focal + " to " + fixed(100.0 * known.focalShare(), 2) + " %";
  if (known.state == slam::LensState::kLearned) {
    return {Level::kGood, "lens", "no calibration is needed, it is learned: " + how_well};
  }
  return {Level::kNote, "lens",
          "no calibration, and not learned yet, " + how_well + ": " + what_helps};
}

std::string misfitText(const slam::LensKnowledge& known, double focal_px) {
  return "does not fit these images: RMS " + fixed(known.rms_given_px, 2) + " px, " +
         fixed(known.rms_after_px, 2) + " with what was learned, focal length " +
         fixed(focal_px, 1) + " instead of " + fixed(known.given.calibration().fx, 1);
}

std::string refinedText(const slam::LensKnowledge& known, double focal_px) {
  return "fits, and the markers know it better: focal length " + fixed(focal_px, 1) +
         " px instead of " + fixed(known.given.calibration().fx, 1) + ", to " +
         fixed(100.0 * known.focalShare(), 2) + " %";
}

std::string formatFinding(const Finding& finding) {
  const char* level = finding.level == Level::kGood   ? "good"
                      : finding.level == Level::kNote ? "note"
                                                      : "BAD";
  return padded(level, 6) + padded(finding.what, 11) + finding.text + "\n";
}

}  // namespace waymark::diagnosis
