#include "slam/camera/camera_share.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "slam/camera/rolling_shutter.h"
#include "slam/geometry/reprojection.h"

namespace waymark::slam {
namespace {

// d normalized / d intrinsics of a corner that stays where it is in the image.
Eigen::Matrix<double, 2, 9> normalizedByLens(const CameraModel& camera,
                                             const Eigen::Vector2d& normalized) {
  Eigen::Matrix2d J;
  (void)camera.distort(normalized, &J);
  return -J.inverse() * camera.intrinsicJacobian(normalized);
}

// d pose / d parameters of the camera. byParameters(marker, corner, projection): d normalized /
// d parameters of a corner. Zero where the normal equations are singular.
template <int Parameters, typename ByParameters>
Eigen::Matrix<double, 6, Parameters> poseByCamera(const PoseSolution& solution,
                                                  std::span<const KnownMarker> markers,
                                                  const ByParameters& byParameters) {
  using Result = Eigen::Matrix<double, 6, Parameters>;
  Matrix6d H = Matrix6d::Zero();
  Result B = Result::Zero();
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!solution.inlier[i]) continue;
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d& p_w = markers[i].corners_w[k];
      Projection projection;
      if (!projectPoint(solution.T_w_c, p_w, &projection)) continue;
      const Eigen::Matrix2d W = whitening(markers[i].detection->covariance[k]);
      const Matrix26d J = W * cameraJacobian(solution.T_w_c, p_w, projection.J_point);
      H.noalias() += J.transpose() * J;
      B.noalias() += J.transpose() * W * byParameters(markers[i], k, projection);
    }
  }
  const Eigen::LLT<Matrix6d> llt(H);
  if (llt.info() != Eigen::Success) return Result::Zero();
  return llt.solve(B);
}

}  // namespace

Matrix6d lensShare(const PoseSolution& solution, std::span<const KnownMarker> markers,
                   const CameraModel& camera, const IntrinsicMatrix& covariance) {
  const Eigen::Matrix<double, 6, 9> K = poseByCamera<9>(
      solution, markers, [&](const KnownMarker&, std::size_t, const Projection& projection) {
        return normalizedByLens(camera, projection.normalized);
      });
  return K * covariance * K.transpose();
}

Matrix6d readoutShare(const PoseSolution& solution, std::span<const KnownMarker> markers,
                      const CameraModel& camera, const Twist& twist, double sigma_s) {
  if (sigma_s == 0.0) return Matrix6d::Zero();
  const Transform T_c_w = solution.T_w_c.inverse();
  // As atMidFrame() moves a corner.
  const auto byReadout = [&](const KnownMarker& marker, std::size_t k, const Projection&) {
    const Eigen::Vector3d p_c = T_c_w * marker.corners_w[k];
    const double row = rowTime(marker.detection->pixels[k].y(), camera.height());
    return Eigen::Vector2d(-row * imageVelocity(p_c, twist));
  };
  const Vector6d per_second = poseByCamera<1>(solution, markers, byReadout);
  const Vector6d step = sigma_s * per_second;
  return step * step.transpose();
}

}  // namespace waymark::slam
