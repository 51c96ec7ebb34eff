#include "slam/covariance/camera_uncertainty.h"

#include <Eigen/LU>

#include "slam/geometry/image_velocity.h"

namespace waymark::slam {
namespace {

constexpr int kLens = 9;

}  // namespace

CameraUncertainty::Unknown CameraUncertainty::unknown() const {
  const bool of_lens = !covariance.diagonal().head<kLens>().isZero(0.0);
  const bool of_readout = covariance(kLens, kLens) != 0.0;
  return {of_lens ? 0 : kLens, (of_lens ? kLens : 0) + (of_readout ? 1 : 0)};
}

CornerByCamera cornerByCamera(const CameraUncertainty& camera, const Eigen::Vector2d& pixel,
                              const Eigen::Vector3d& p_c, const Twist& twist,
                              std::int64_t time_ns) {
  CornerByCamera by_camera = CornerByCamera::Zero();
  const auto [first, count] = camera.unknown();
  if (first < kLens && time_ns >= camera.since_ns) {
    const Eigen::Vector2d normalized = p_c.head<2>() / p_c.z();
    Eigen::Matrix2d J;
    (void)camera.camera->distort(normalized, &J);
    by_camera.leftCols<kLens>() = -J.inverse() * camera.camera->intrinsicJacobian(normalized);
  }
  if (first + count > kLens) {  // as atMidFrame() moves a corner
    by_camera.col(kLens) = -rowTime(pixel.y(), camera.camera->height()) * imageVelocity(p_c, twist);
  }
  return by_camera;
}

}  // namespace waymark::slam
