// What is known of the markers (MarkerConstraints) as residuals: frames that markers are tied to,
// unknowns themselves, and what they come to.
//
// - positions: the world, fixed; a marker's centre is there.
// - plane: z out of it; a centre is at z = 0, and a marker's z axis along z.
// - upright, level: the vertical as its z axis, fixed where told; along z is a marker's y axis, or
//   its plane's z axis.
// - distance: a ruler, zero at one corner, x to the other, which is on it.
//
// A frame of its own makes every residual one of a marker in a frame, as in a camera: the normal
// equations have no blocks between markers. The ruler is as good as the distance itself: of its six
// residuals its own pose takes up all but the one along it, and of the variance either end has
// half.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/bundle_problem.h"

namespace waymark::slam {

// What a residual is of.
struct ConstraintSource {
  enum class Kind {
    kAnchor,  // where it is; index: of MarkerOptions::anchors
    kAnchorTurn,
    kPosition,   // index: of MarkerConstraints::positions
    kPlane,      // the marker's centre; index: of planes
    kPlaneTilt,  // its face
    kLevel,      // the share of its plane's attitude to the vertical
    kUpright,
    kDistance,  // index: of distances; marker: the first end's
  };
  Kind kind = Kind::kPosition;
  std::size_t index = 0;
  int marker = -1;
};

struct ConstrainedMarker {
  int id = -1;
  Transform T_w_m;
  double size_m = 0.0;
};

struct ConstraintFrame {
  struct Member {
    std::size_t marker = 0;  // index into the markers given
    std::vector<BundleProblem::Relation> relations;
  };
  Transform T_w_f{};
  bool fixed = false;
  Vector6d gauge = Vector6d::Zero();  // BundleProblem::Gauge::information
  std::vector<Member> members{};
};

// A distance between corners of two markers that are there.
struct MeasuredDistance {
  std::size_t a = 0;  // index into the markers given
  std::size_t b = 0;
  Eigen::Vector3d in_a = Eigen::Vector3d::Zero();  // the corners, metres
  Eigen::Vector3d in_b = Eigen::Vector3d::Zero();
  double distance_m = 0.0;
  double sigma_m = 0.0;
  int source = -1;
};

struct ConstraintFrames {
  std::vector<ConstraintFrame> frames;  // all but the rulers
  std::vector<MeasuredDistance> distances;
  std::vector<ConstraintSource> sources;  // by BundleProblem::Relation::source
};

// The markers with a pose that something is known of, ascending.
[[nodiscard]] std::vector<ConstrainedMarker> constrainedMarkers(const Map& map,
                                                                const MarkerOptions& options);

// Of markers that are there (ascending). Frames are where these, robustly, have them. A frame that
// would tie fewer than two markers, and is not fixed, is left out. in_survey: the markers are in
// the world of the surveyed positions.
[[nodiscard]] ConstraintFrames constraintFrames(const MarkerConstraints& constraints,
                                                std::span<const ConstrainedMarker> markers,
                                                bool in_survey);
// The ruler of a distance, laid as well as it can be.
[[nodiscard]] ConstraintFrame rulerOf(const MeasuredDistance& distance,
                                      std::span<const ConstrainedMarker> markers);

}  // namespace waymark::slam
