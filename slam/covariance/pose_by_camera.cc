#include "slam/covariance/pose_by_camera.h"

#include <Eigen/Cholesky>

#include "slam/geometry/reprojection.h"

namespace waymark::slam {

PoseGlobalMatrix poseByCamera(const PoseSolution& solution, std::span<const KnownMarker> markers,
                              const CameraUncertainty& camera, const Twist& twist,
                              std::int64_t time_ns) {
  if (camera.unknown().count == 0) return PoseGlobalMatrix::Zero();
  Matrix6d H = Matrix6d::Zero();
  PoseGlobalMatrix B = PoseGlobalMatrix::Zero();
  const Transform T_c_w = solution.T_w_c.inverse();
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!solution.inlier[i]) continue;
    const MarkerDetection& detection = *markers[i].detection;
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d& p_w = markers[i].corners_w[k];
      Projection projection;
      if (!projectPoint(solution.T_w_c, p_w, &projection)) continue;
      const Eigen::Matrix2d W = whitening(detection.covariance[k]);
      const Matrix26d J = W * cameraJacobian(solution.T_w_c, p_w, projection.J_point);
      H.noalias() += J.transpose() * J;
      const CornerByCamera by_camera =
          cornerByCamera(camera, detection.pixels[k], T_c_w * p_w, twist, time_ns);
      B.noalias() += J.transpose() * (W * by_camera);
    }
  }
  const Eigen::LLT<Matrix6d> llt(H);
  if (llt.info() != Eigen::Success) return PoseGlobalMatrix::Zero();
  return llt.solve(B);
}

Matrix6d covarianceByCamera(const CameraUncertainty& camera, const PoseGlobalMatrix& by_camera) {
  Matrix6d covariance = by_camera * camera.covariance * by_camera.transpose();
  const double focal_variance = camera.covariance(0, 0);
  if (focal_variance == 0.0) return covariance;
  const double focal_px = camera.camera->calibration().fx;
  const double share = focal_variance / (focal_px * focal_px);
  for (const Eigen::Index part : {0, 3}) {
    auto block = covariance.block<3, 3>(part, part);
    block.diagonal().array() += share * block.trace() / 3.0;
  }
  return covariance;
}

}  // namespace waymark::slam
