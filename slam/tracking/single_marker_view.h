// What one image says of a single known marker's two poses (seed 1, section 3.2), and what is told
// of a pose that is one of two.
#pragma once

#include <array>
#include <optional>

#include "slam/camera_pose/known_marker.h"
#include "slam/marker_pose/square_pose.h"

namespace waymark::slam {

struct SingleMarkerView {
  std::array<Transform, 2> T_m_c;  // the one that explains the image better first
  double log_odds = 0.0;           // of the first over the second; not negative
  // How much worse the pose half-way between them explains the image, in squared whitened
  // residuals.
  double barrier = 0.0;
};

// Empty where the corners give no pose. What lens and paper add to the corners' noise
// (square.systematic_sigma_px) speaks for neither, and is taken out of both numbers.
[[nodiscard]] std::optional<SingleMarkerView> viewSingleMarker(const KnownMarker& marker,
                                                               double focal_px,
                                                               const SquarePoseOptions& square);

// A pose that is one of two.
struct PoseOfTwo {
  Transform T_w_c;           // the pose
  Transform other_T_w_c;     // and the other one
  Eigen::Vector3d marker_w;  // the middle of the marker, world frame, metres
  double log_odds = 0.0;     // of the pose over the other one
  // As SingleMarkerView's; where nothing is between the two, over the pose itself.
  double barrier = 0.0;
  bool decided = false;
  // Nothing is decided, but the two are so close to each other that it hardly matters: the pose's
  // covariance has both. Whoever refines the pose tells.
  bool covered = false;

  // The same, told of the refined pose of one of them.
  [[nodiscard]] PoseOfTwo at(const Transform& refined_T_w_c) const;
};
// What its covariance has to be widened by. As far as the corners allow along the way to the other
// pose, which is no parabola. Where nothing is decided, to the other pose as often as that is the
// right one. And by the arc: a camera turned about the marker leaves the tangent, which (dp,
// dtheta) are linear along, by more than it errs across it. view_covariance: of (dp, dtheta) given
// the marker's place.
[[nodiscard]] Matrix6d coverOfOtherPose(const PoseOfTwo& pose, const Matrix6d& view_covariance);
// The ambiguity that is told of it: at least `unambiguous` once it is decided, below until then.
// image: what the image alone would say. min_log_odds: those of a decision.
[[nodiscard]] double ambiguityOf(const PoseOfTwo& pose, double image, double unambiguous,
                                 double min_log_odds);

}  // namespace waymark::slam
