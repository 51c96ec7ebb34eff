// What bench gaps tells of the poses between markers.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "io/text/json_node.h"

namespace waymark::bench {

// Seconds into a gap at which a carried pose is compared.
inline constexpr std::array<double, 4> kInto_s = {1.0, 2.0, 5.0, 10.0};

// A pose that was carried, against the truth.
struct Carried {
  double error_m = 0.0;
  double from_marker_m = 0.0;
  double turn_from_marker_deg = 0.0;
  double sigma_m = 0.0;  // of the position, the root of the covariance's trace
  double nees = 0.0;
};

struct Gap {
  double begin_s = 0.0;  // of the last pose from markers
  double end_s = 0.0;    // of the last frame before the next one
  double way_m = 0.0;
  std::array<std::optional<Carried>, kInto_s.size()> into{};
  std::optional<Carried> last{};
  double scale = 0.0;              // of the way since the beginning: estimated over true, less 1
  std::optional<double> jump_m{};  // at the next marker
  int frames = 0;
  int posed = 0;
};

// Poses in a row whose NEES is above 9 * 6: 3 sigma in every coordinate.
struct Beyond {
  double begin_s = 0.0;
  double end_s = 0.0;
  double worst_m = 0.0;     // how far off the worst of them is
  bool by_markers = false;  // all of them are from markers
};

// Of all runs of a scene.
struct GapReport {
  std::vector<Gap> gaps;
  std::vector<double> cpu_ms;  // of every frame
  int frames = 0;              // since the first pose
  int posed = 0;
  int beyond_3_sigma = 0;  // frames
  std::vector<Beyond> beyond;
  // Of the live maps at the end: the error of the distance between the two markers that are
  // farthest from each other.
  std::vector<double> distance_errors_mm;
  int mapped = 0;   // markers
  int markers = 0;  // that there are
};

// Of one scene: shares in percent, lengths in millimetres where their name says so, else metres;
// "rms" over all gaps that got so far.
[[nodiscard]] io::Json summaryOf(const std::string& scene, GapReport report);

// That, for people; every_gap: with a line for each.
void print(const io::Json& summary, bool every_gap);

}  // namespace waymark::bench
