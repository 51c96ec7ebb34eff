// What bench gaps tells of the poses between markers.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "io/text/json_node.h"

namespace waymark::bench {

// Seconds into a gap at which a carried pose is compared.
inline constexpr std::array<double, 4> kInto_s = {1.0, 2.0, 5.0, 10.0};

// Of the way from the last pose from markers on, along it.
struct Scale {
  double error = 0.0;  // estimated over true, less 1
  double sigma = 0.0;  // as told, at most
};

// A pose that was carried, against the truth.
struct Carried {
  double error_m = 0.0;
  double from_marker_m = 0.0;
  double turn_from_marker_deg = 0.0;
  double sigma_m = 0.0;        // of the position, the root of the covariance's trace
  double sigma_along_m = 0.0;  // of the position, along its error
  double nees = 0.0;
  std::optional<Scale> scale{};  // of a way that is long enough
};

struct Gap {
  double begin_s = 0.0;  // of the last pose from markers
  double end_s = 0.0;    // of the last frame before the next one
  double way_m = 0.0;
  std::array<std::optional<Carried>, kInto_s.size()> into{};
  std::optional<Carried> last{};
  std::optional<double> jump_m{};  // at the next marker
  int frames = 0;
  int posed = 0;
};

// Poses in a row that are beyond three standard deviations.
struct Beyond {
  double begin_s = 0.0;
  double end_s = 0.0;       // of the frame after them
  double worst_m = 0.0;     // how far off the worst of them is
  bool by_markers = false;  // all of them are from markers
};

// Of all runs of a scene.
struct GapReport {
  std::vector<Gap> gaps;
  // CPU time of every frame, and what natural features take of it.
  std::vector<double> cpu_ms;
  std::vector<double> features_ms;
  int frames = 0;  // since the first pose
  int posed = 0;
  int beyond_3_sigma = 0;               // frames
  std::vector<Beyond> beyond;           // NEES above 9 * 6: 3 sigma in every coordinate
  std::vector<Beyond> beyond_position;  // an error above three of what is told along it
  // Of the live maps at the end: the error of the distance between the two markers that are
  // farthest from each other.
  std::vector<double> distance_errors_mm;
  int mapped_first_way = 0;  // markers, after the first way
  int mapped = 0;            // at the end
  int markers = 0;           // that there are

  void add(const GapReport& run);
};

// Of one scene: shares in percent, lengths in millimetres where their name says so, else metres;
// "rms" over all gaps that got so far.
[[nodiscard]] io::Json summaryOf(const std::string& scene, GapReport report);

// That, for people.
void print(const io::Json& summary);

// One run, as it ends: a line for each of its gaps.
void printRun(const std::string& scene, std::uint64_t seed, const GapReport& run);

}  // namespace waymark::bench
