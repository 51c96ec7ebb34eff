#include "slam/camera/lens_share.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "slam/geometry/reprojection.h"

namespace waymark::slam {
namespace {

using PoseByLens = Eigen::Matrix<double, 6, 9>;

// d normalized / d intrinsics of a corner that stays where it is in the image.
Eigen::Matrix<double, 2, 9> normalizedByLens(const CameraModel& camera,
                                             const Eigen::Vector2d& normalized) {
  Eigen::Matrix2d J;
  (void)camera.distort(normalized, &J);
  return -J.inverse() * camera.intrinsicJacobian(normalized);
}

}  // namespace

Matrix6d lensShare(const PoseSolution& solution, std::span<const KnownMarker> markers,
                   const CameraModel& camera, const IntrinsicMatrix& covariance) {
  Matrix6d H = Matrix6d::Zero();
  PoseByLens B = PoseByLens::Zero();
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!solution.inlier[i]) continue;
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d& p_w = markers[i].corners_w[k];
      Projection projection;
      if (!projectPoint(solution.T_w_c, p_w, &projection)) continue;
      const Eigen::Matrix2d W = whitening(markers[i].detection->covariance[k]);
      const Matrix26d J = W * cameraJacobian(solution.T_w_c, p_w, projection.J_point);
      H.noalias() += J.transpose() * J;
      B.noalias() += J.transpose() * W * normalizedByLens(camera, projection.normalized);
    }
  }
  const Eigen::LLT<Matrix6d> llt(H);
  if (llt.info() != Eigen::Success) return Matrix6d::Zero();
  const PoseByLens K = llt.solve(B);
  return K * covariance * K.transpose();
}

}  // namespace waymark::slam
