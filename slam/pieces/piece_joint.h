// How two pieces of the map lie to each other, from frames that show markers of both. Each such
// frame is located in both; a single marker may leave two poses in each, so that it leaves up to
// four ways. All frames together decide, or do not yet.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/marker_pose/square_pose.h"
#include "slam/pieces/piece_options.h"

namespace waymark::slam {

// What one frame says.
struct JointView {
  struct Way {
    Transform T_a_b;
    Matrix6d information = Matrix6d::Zero();  // of (dp, dtheta) of T_a_b
    double chi2 = 0.0;  // of the frame's corners, more than that of its best way
  };
  std::vector<Way> ways;  // at least one
};

// How two pieces lie to each other.
struct PieceJoint {
  Transform T_a_b;                         // puts the markers of b into the world of a
  Matrix6d covariance = Matrix6d::Zero();  // of (dp, dtheta): metres, radians, in the world of a
  int views = 0;                           // frames that agree
  double ratio = 1.0;  // how many times better than another way; infinite without one
};

// What the estimate needs of the camera and its poses; it must outlive the call.
struct JointParts {
  const PoseOptimizer& optimizer;
  const SquarePoseOptions& square;
  double focal_px = 1.0;
  const PieceOptions& options;
};

// One frame's markers that are known in a, and in b. Empty where it has no pose in one of them.
[[nodiscard]] std::optional<JointView> viewJoint(std::span<const KnownMarker> in_a,
                                                 std::span<const KnownMarker> in_b,
                                                 const JointParts& parts);

// What the keyframes of either piece say that see markers of both; of more than max_views those
// spread over all.
[[nodiscard]] std::vector<JointView> connectingViews(const Map& a, const Map& b,
                                                     const JointParts& parts);

// Empty where nothing decides, or the frames contradict each other.
[[nodiscard]] std::optional<PieceJoint> estimateJoint(std::span<const JointView> views,
                                                      const PieceOptions& options);

}  // namespace waymark::slam
