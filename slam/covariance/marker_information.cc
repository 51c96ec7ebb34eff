#include "slam/covariance/marker_information.h"

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
    const Eigen::Vector3d corner_w = T_w_m * corners_m[k];
    Projection projection;
    if (!projectPoint(T_w_c, corner_w, &projection)) return std::nullopt;
    const Matrix26d J = markerJacobian(T_w_m, corner_w, projection.J_point);
    const Eigen::Matrix2d& R = detection.covariance[k];
    if (sure) {
      const Matrix26d WJ = whitening(R) * J;
      information.weighted.noalias() += WJ.transpose() * WJ;
      continue;
    }
    const Eigen::Matrix2d W = (R + kShared * J * doubt * J.transpose()).inverse();
    const Matrix26d WJ = W * J;
    information.weighted.noalias() += J.transpose() * WJ;
    information.noise.noalias() += WJ.transpose() * R * WJ;
  }
  if (sure) information.noise = information.weighted;
  return information;
}

}  // namespace waymark::slam
