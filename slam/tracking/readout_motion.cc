#include "slam/tracking/readout_motion.h"

#include <Eigen/Cholesky>

#include "slam/geometry/image_velocity.h"
#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/reprojection.h"

namespace waymark::slam {
namespace {

// Normal equations of a pose and of what is added to the motion.
struct Normal {
  Matrix6d pose = Matrix6d::Zero();
  Matrix6d pose_motion = Matrix6d::Zero();
  Matrix6d motion = Matrix6d::Zero();
  Vector6d g_pose = Vector6d::Zero();
  Vector6d g_motion = Vector6d::Zero();
};

void addMarker(const KnownMarker& marker, const Transform& T_w_c, const WhitenedCorners& W,
               const Deskewing& deskewing, Normal* normal) {
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d& p_w = marker.corners_w[k];
    Projection projection;
    if (!projectPoint(T_w_c, p_w, &projection)) continue;
    const MarkerDetection& seen = *marker.detection;
    const double late_s =
        deskewing.readout_s * rowTime(seen.pixels[k].y(), deskewing.camera.height());
    const Eigen::Vector3d p_c = T_w_c.R.transpose() * (p_w - T_w_c.p);
    const Eigen::Vector2d r = W[k] * (projection.normalized - seen.normalized[k]);
    const Matrix26d J = W[k] * cameraJacobian(T_w_c, p_w, projection.J_point);
    const Matrix26d B = late_s * W[k] * imageVelocityJacobian(p_c);
    normal->pose.noalias() += J.transpose() * J;
    normal->pose_motion.noalias() += J.transpose() * B;
    normal->motion.noalias() += B.transpose() * B;
    normal->g_pose.noalias() += J.transpose() * r;
    normal->g_motion.noalias() += B.transpose() * r;
  }
}

}  // namespace

std::optional<ReadoutMotion> estimateReadoutMotion(const PoseSolution& solution,
                                                   std::span<const KnownMarker> markers,
                                                   const Deskewing& deskewing,
                                                   const ExpectedMotion& expected) {
  if (solution.inliers == 0) return std::nullopt;
  Normal normal;
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!solution.inlier[i]) continue;
    const auto W = whiteningOf(markers[i], solution.T_w_c);
    if (!W) return std::nullopt;
    addMarker(markers[i], solution.T_w_c, *W, deskewing, &normal);
  }
  const auto pose_covariance = inverseOf(normal.pose);
  const auto prior = inverseOf(expected.covariance);
  if (!pose_covariance || !prior) return std::nullopt;
  // The pose follows the motion: dpose = -by_motion * dmotion.
  const Matrix6d by_motion = *pose_covariance * normal.pose_motion;
  const double weight = 1.0 / solution.residual_variance;
  const Matrix6d information =
      weight * (normal.motion - normal.pose_motion.transpose() * by_motion) + *prior;
  const auto covariance = inverseOf(information);
  if (!covariance) return std::nullopt;
  const Vector6d pull = *prior * (expected.twist - deskewing.twist) -
                        weight * (normal.g_motion - by_motion.transpose() * normal.g_pose);
  return ReadoutMotion{deskewing.twist + *covariance * pull,
                       by_motion * *covariance * by_motion.transpose()};
}

}  // namespace waymark::slam
