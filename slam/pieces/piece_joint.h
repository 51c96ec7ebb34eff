// How two pieces of the map lie to each other, from frames that show markers of both. Each such
// frame is located in both; a single marker may leave two poses in each, so that it leaves up to
// four ways. All frames together decide, or do not yet.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/marker_pose/square_pose.h"
#include "slam/pieces/piece_options.h"

namespace waymark::slam {

// So many of a view's markers, those seen best, propose where a camera is in a piece; all decide.
inline constexpr std::size_t kProposing = 3;

// What one frame says.
struct JointView {
  struct Way {
    Transform T_a_b;
    Matrix6d information = Matrix6d::Zero();  // of (dp, dtheta) of T_a_b
    double chi2 = 0.0;  // of the frame's corners, more than that of its best way
  };
  std::vector<Way> ways;     // at least one
  bool other_print = false;  // the frame shows another print of an id that hangs twice
};

// How two pieces lie to each other.
struct PieceJoint {
  Transform T_a_b;                         // puts the markers of b into the world of a
  Matrix6d covariance = Matrix6d::Zero();  // of (dp, dtheta): metres, radians, in the world of a
  int views = 0;                           // frames that agree; 0: it is known otherwise
  double ratio = 1.0;  // how many times better than another way; infinite without one
};

// What the estimate needs of the camera and its poses; it must outlive the call.
struct JointParts {
  const PoseOptimizer& optimizer;
  const SquarePoseOptions& square;
  const CameraModel& camera;
  const PieceOptions& options;
};

// One frame's markers that are known in a, and in b. Empty where it has no pose in one of them.
[[nodiscard]] std::optional<JointView> viewJoint(std::span<const KnownMarker> in_a,
                                                 std::span<const KnownMarker> in_b,
                                                 const JointParts& parts);

// The same of a frame's detections, of markers that either piece has a pose of.
[[nodiscard]] std::optional<JointView> viewJoint(const Map& a, const Map& b,
                                                 std::span<const MarkerDetection> detections,
                                                 const JointParts& parts);

// The same of a keyframe of `own`, which may also hang there by a link: natural features, or a
// picture, know where it is.
[[nodiscard]] std::optional<JointView> viewJoint(const Map& a, const Map& b, const Map& own,
                                                 const Keyframe& keyframe, const JointParts& parts);

// Whether what a frame says contradicts a joint: chi-square, or an id that hangs twice.
[[nodiscard]] bool contradicts(const JointView& view, const Transform& T_a_b,
                               const PieceOptions& options);

// Whether markers of b hang where others of a do: then the two do not lie like that to each other.
[[nodiscard]] bool overlap(const Map& a, const Map& b, const Transform& T_a_b);

// Empty where nothing decides, or the frames contradict each other.
[[nodiscard]] std::optional<PieceJoint> estimateJoint(std::span<const JointView> views,
                                                      const PieceOptions& options);

}  // namespace waymark::slam
