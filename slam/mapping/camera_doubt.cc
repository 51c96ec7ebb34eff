#include "slam/mapping/camera_doubt.h"

#include <cstddef>

#include <Eigen/Cholesky>

#include "slam/geometry/reprojection.h"
#include "slam/marker_pose/square_pose.h"

namespace waymark::slam {

MarkerDetection withCameraDoubt(const Keyframe& keyframe, int marker_id, double size_m,
                                const Map& map, double residual_sigma) {
  MarkerDetection doubted = *keyframe.find(marker_id);
  Matrix6d information = Matrix6d::Zero();  // of the camera
  for (const MarkerDetection& seen : keyframe.detections) {
    const MapMarker* const marker = seen.id == marker_id ? nullptr : map.findPosed(seen.id);
    if (marker == nullptr) continue;
    const auto corners = marker->cornersInWorld();
    for (std::size_t k = 0; k < 4; ++k) {
      Projection projection;
      if (!projectPoint(keyframe.T_w_c, corners[k], &projection)) continue;
      const Matrix26d J_c = cameraJacobian(keyframe.T_w_c, corners[k], projection.J_point);
      const Matrix26d J_m = markerJacobian(*marker->T_w_m, corners[k], projection.J_point);
      const Eigen::Matrix2d covariance = residual_sigma * residual_sigma * seen.covariance[k] +
                                         J_m * marker->covariance * J_m.transpose();
      information += J_c.transpose() * covariance.inverse() * J_c;
    }
  }
  const Eigen::LLT<Matrix6d> llt(information);
  if (llt.info() != Eigen::Success) return doubted;
  const auto solutions = estimateSquarePose(doubted, size_m, /*focal_px=*/1.0);
  if (!solutions) return doubted;
  const auto corners = markerCorners(size_m);
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d p_w = keyframe.T_w_c * (solutions->T_c_m[0] * corners[k]);
    Projection projection;
    if (!projectPoint(keyframe.T_w_c, p_w, &projection)) continue;
    const Matrix26d J_c = cameraJacobian(keyframe.T_w_c, p_w, projection.J_point);
    doubted.covariance[k] += J_c * llt.solve(J_c.transpose());
  }
  return doubted;
}

}  // namespace waymark::slam
