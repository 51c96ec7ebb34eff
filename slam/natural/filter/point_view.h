// What the filter expects to see of a point that hangs on one of its poses, with Jacobians.
//
// A measurement of the camera relative to that pose: the Jacobian by the camera's error is minus
// that by the pose's, so that a motion of the whole world changes nothing (filter_state.h).
#pragma once

#include <optional>

#include <Eigen/Core>

#include "slam/geometry/camera_model.h"
#include "slam/geometry/reprojection.h"
#include "slam/natural/filter/filter_state.h"

namespace waymark::slam {

struct PointView {
  Eigen::Vector2d at;   // normalized coordinates, or pixels
  Matrix26d J_pose;     // d at / d xi of the pose; of the camera: -J_pose
  Matrix23d J_feature;  // d at / d (u, v, rho)
  // d log(depth) / d (u, v, rho) at a fixed point of the anchor's ray: what makes a surface's image
  // more than affine. Of features only.
  Eigen::RowVector3d J_forward = Eigen::RowVector3d::Zero();
};

// Where a feature lies in a camera's frame, times its inverse depth: finite also when it is
// infinitely far away.
[[nodiscard]] inline Eigen::Vector3d directionTo(const StateFeature& feature,
                                                 const Transform& T_w_a, const Transform& T_w_c) {
  const Eigen::Vector3d ray_w = T_w_a.R * Eigen::Vector3d(feature.uv.x(), feature.uv.y(), 1.0);
  return T_w_c.R.transpose() * (ray_w + feature.rho * (T_w_a.p - T_w_c.p));
}

// A feature, in pixels. False behind the camera or outside the lens's range.
[[nodiscard]] bool viewFeature(const CameraModel& camera, const Transform& T_w_c,
                               const Transform& T_w_a, const StateFeature& feature,
                               PointView* view);

// How deep a feature is in a camera: 1 / metres along its optical axis.
struct DepthView {
  double rho = 0.0;
  Eigen::Matrix<double, 1, 6> J_pose;  // d rho / d xi of the anchor; by the camera's: minus that
  Eigen::RowVector3d J_feature;        // d rho / d (u, v, rho)
};
// Empty where the camera cannot see it.
[[nodiscard]] std::optional<DepthView> viewDepth(const Transform& T_w_c, const Transform& T_w_a,
                                                 const StateFeature& feature);

// A point at p_s in the frame of a pose, in normalized coordinates; J_feature is zero. False behind
// the camera.
[[nodiscard]] bool viewPoint(const Transform& T_w_c, const Transform& T_w_s,
                             const Eigen::Vector3d& p_s, PointView* view);

}  // namespace waymark::slam
