// How far an estimate is from the truth: the measures of seed 1, section 5.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/result.h"
#include "io/maps/map_file.h"
#include "io/maps/visible_markers.h"
#include "io/trajectory.h"
#include "slam/geometry/transform.h"

namespace waymark::tools {

struct ErrorStatistics {
  double mean = 0.0;
  double rms = 0.0;
  double median = 0.0;
  double max = 0.0;
};
// Zeros for an empty list.
[[nodiscard]] ErrorStatistics errorStatistics(std::vector<double> errors);

struct TrajectoryOptions {
  // Poses further apart in time are not the same frame. 2 ms: above the rounding of Matroska's
  // times (0.5 ms), below half the period of any camera here.
  std::int64_t tolerance_ns = 2'000'000;
  // Length of path over which relative errors are taken, metres; the seed's.
  double segment_m = 0.25;
};

void sortByTime(io::Trajectory* trajectory);
// Null when none is within the tolerance. Precondition: sorted by time.
[[nodiscard]] const io::StampedPose* nearestPose(const io::Trajectory& trajectory,
                                                 std::int64_t time_ns, std::int64_t tolerance_ns);

struct TrajectoryErrors {
  std::size_t truth_poses = 0;
  std::size_t matched = 0;      // truth poses that have an estimate
  slam::Transform T_truth_est;  // the alignment of the two worlds
  ErrorStatistics ate_m;        // ATE: position, after alignment; the seed's is the mean
  // Over every stretch of segment_m along the true path, as KITTI takes them: no alignment needed.
  std::size_t segments = 0;
  double t_rel_percent = 0.0;  // mean position error at the stretch's end, of segment_m
  double r_rel_deg = 0.0;      // mean rotation error there: degrees per segment_m

  [[nodiscard]] double coverage() const {
    return truth_poses == 0 ? 0.0 : static_cast<double>(matched) / static_cast<double>(truth_poses);
  }
};

// Both in any order of time. An error when no two poses share a time.
[[nodiscard]] Result<TrajectoryErrors> compareTrajectories(const io::Trajectory& truth,
                                                           const io::Trajectory& estimate,
                                                           const TrajectoryOptions& options);

// One of the estimate's worlds, aligned by itself.
struct PieceErrors {
  int piece = 0;
  std::size_t markers = 0;
  ErrorStatistics ace_m;
};

struct MapErrors {
  std::size_t common = 0;    // markers in both
  std::vector<int> missing;  // ids only in the truth
  std::vector<int> unknown;  // ids only in the estimate
  // Of the estimate, with markers in both.
  std::vector<PieceErrors> pieces;
  ErrorStatistics ace_m;  // ACE: corner, after alignment; the seed's is the mean
};

// In how many of the frames in which a pose could be expected there is one.
struct ViewCoverage {
  std::size_t frames = 0;     // in which a mapped marker is in view, large enough
  std::size_t localized = 0;  // of those

  [[nodiscard]] double share() const {
    return frames == 0 ? 0.0 : static_cast<double>(localized) / static_cast<double>(frames);
  }
};
struct ViewCoverageOptions {
  // Shortest side of a marker that can be expected to be found, pixels: 20 px are 2 to 3 pixels a
  // cell, enough for noisy and blurred images.
  double min_side_px = 20.0;
  std::int64_t tolerance_ns = 2'000'000;  // as TrajectoryOptions'
};
[[nodiscard]] ViewCoverage viewCoverage(std::span<const io::VisibleMarker> visible,
                                        std::span<const io::MarkerCorners> map,
                                        io::Trajectory estimate,
                                        const ViewCoverageOptions& options);

// An error when no marker is in both.
[[nodiscard]] Result<MapErrors> compareMaps(std::span<const io::MarkerCorners> truth,
                                            std::span<const io::MarkerCorners> estimate);

}  // namespace waymark::tools
