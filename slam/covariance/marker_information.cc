#include "slam/covariance/marker_information.h"

#include <Eigen/Cholesky>

#include "slam/covariance/corner_rows.h"
#include "slam/geometry/reprojection.h"

namespace waymark::slam {

std::optional<MarkerInformation> markerInformation(const Transform& T_w_m, double size_m,
                                                   const MarkerDetection& detection,
                                                   const Transform& T_w_c, const Matrix6d& doubt) {
  constexpr double kShared = 4.0;  // as in PoseOptimizer: each corner carries its part of the doubt
  const bool sure = doubt.isZero(0.0);
  const auto corners_m = markerCorners(size_m);
  CornerRows rows;
  CornerRows of_noise;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d arm = T_w_m.R.leftCols<2>() * corners_m[k].head<2>();
    Projection projection;
    if (!projectPoint(T_w_c, T_w_m.p + arm, &projection)) return std::nullopt;
    const Eigen::Matrix2d& R = detection.covariance[k];
    if (sure) {
      rows.set(k, whitening(R) * projection.J_point, arm);
      continue;
    }
    rows.set(k, projection.J_point, arm);
    // V^T V = W; W R W = V^T (V R V^T) V, and U U^T = V R V^T.
    const Eigen::Matrix2d V = whitening(R + kShared * rows.spread(k, doubt));
    const Eigen::Matrix2d U = (V * R * V.transpose()).llt().matrixL();
    const Matrix23d weighted = V * projection.J_point;
    rows.set(k, weighted, arm);
    of_noise.set(k, U.transpose() * weighted, arm);
  }
  MarkerInformation information;
  information.weighted = rows.square();
  information.noise = sure ? information.weighted : of_noise.square();
  return information;
}

}  // namespace waymark::slam
