#include "slam/covariance/marker_information.h"

#include <Eigen/LU>

#include "slam/covariance/corner_sums.h"
#include "slam/geometry/reprojection.h"

namespace waymark::slam {

std::optional<MarkerInformation> markerInformation(const Transform& T_w_m, double size_m,
                                                   const MarkerDetection& detection,
                                                   const Transform& T_w_c, const Matrix6d& doubt) {
  constexpr double kShared = 4.0;  // as in PoseOptimizer: each corner carries its part of the doubt
  const bool sure = doubt.isZero(0.0);
  const auto corners_m = markerCorners(size_m);
  MarkerInformation information;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d arm = T_w_m.R.leftCols<2>() * corners_m[k].head<2>();
    Projection projection;
    if (!projectPoint(T_w_c, T_w_m.p + arm, &projection)) return std::nullopt;
    const Matrix23d& P = projection.J_point;
    const Eigen::Matrix2d& R = detection.covariance[k];
    if (sure) {
      addSquare(P, arm, R.inverse(), &information.weighted);
      continue;
    }
    const Eigen::Matrix2d W = (R + kShared * spreadOfCorner(P, arm, doubt)).inverse();
    addSquare(P, arm, W, &information.weighted);
    addSquare(P, arm, W * R * W, &information.noise);
  }
  mirror(&information.weighted);
  mirror(&information.noise);
  if (sure) information.noise = information.weighted;
  return information;
}

}  // namespace waymark::slam
