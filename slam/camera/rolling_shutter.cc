#include "slam/camera/rolling_shutter.h"

#include <algorithm>
#include <cmath>

#include "slam/geometry/reprojection.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Of a marker in the image; where the map does not know it, as its size tells.
std::array<double, 4> depthsOf(const MarkerDetection& seen, const Transform& T_w_c,
                               const std::optional<Transform>& T_w_m, double size_m) {
  const auto known = T_w_m ? depthFromPose(T_w_c, *T_w_m, size_m) : std::nullopt;
  return known ? *known : depthFromSize(seen, size_m);
}

}  // namespace

std::string RollingShutterOptions::invalidReason() const {
  return firstUnmet({
      {!readout_s || std::isfinite(*readout_s), "the readout time must be a number"},
      {std::isfinite(learned_s), "the learned readout time must be a number"},
      {isNotNegative(min_s) && max_s >= min_s, "the range of readout times is empty"},
      {isNotNegative(min_sigmas) && isNotNegative(min_change_sigmas),
       "the sigmas of a readout time must not be negative"},
      {first_keyframes >= 1 && max_keyframes >= 1, "a readout time needs at least 1 keyframe"},
      {isNotNegative(unknown_s), "the sigma of an unknown readout time must not be negative"},
      {growth > 1.0, "the map must grow before the readout time is estimated again"},
  });
}

MarkerDetection atMidFrame(const MarkerDetection& seen, const CameraModel& camera,
                           const Twist& twist, const std::array<double, 4>& depth_m,
                           double readout_s) {
  MarkerDetection corrected = seen;
  for (std::size_t k = 0; k < 4; ++k) {
    const double late_s = readout_s * rowTime(seen.pixels[k].y(), camera.height());
    const Eigen::Vector3d p_c = depth_m[k] * seen.normalized[k].homogeneous();
    corrected.normalized[k] -= late_s * imageVelocity(p_c, twist);
  }
  return corrected;
}

std::array<double, 4> depthFromSize(const MarkerDetection& seen, double size_m) {
  double perimeter = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    perimeter += (seen.normalized[(k + 1) % 4] - seen.normalized[k]).norm();
  }
  std::array<double, 4> depth_m;
  depth_m.fill(4.0 * size_m / std::max(perimeter, 1e-9));
  return depth_m;
}

std::optional<std::array<double, 4>> depthFromPose(const Transform& T_w_c, const Transform& T_w_m,
                                                   double size_m) {
  const Transform T_c_m = T_w_c.inverse() * T_w_m;
  const auto corners = markerCorners(size_m);
  std::array<double, 4> depth_m;
  for (std::size_t k = 0; k < 4; ++k) {
    depth_m[k] = (T_c_m * corners[k]).z();
    if (depth_m[k] < kNearestDepth) return std::nullopt;
  }
  return depth_m;
}

std::optional<MarkerDetection> deskewed(const MarkerDetection& seen, const CameraModel& camera,
                                        const Transform& T_w_c, const Twist& twist,
                                        const std::optional<Transform>& T_w_m, double size_m,
                                        double readout_s) {
  MarkerDetection undistorted = seen;
  if (!undistortCorners(camera, &undistorted)) return std::nullopt;
  if (readout_s == 0.0) return undistorted;
  // Corrected before, if only with a predicted velocity, the corners tell the size better.
  return atMidFrame(undistorted, camera, twist, depthsOf(seen, T_w_c, T_w_m, size_m), readout_s);
}

void doubtReadout(const CameraModel& camera, const Transform& T_w_c, const Twist& twist,
                  const std::optional<Transform>& T_w_m, double size_m, double sigma_s,
                  MarkerDetection* detection) {
  // Of the corners' standard deviation. What is less does not matter. More than the most would be
  // honest, too; but a fast camera's first poses are only as exact as the corners that still count,
  // and its shutter may be a global one: a room that is seen within two seconds suffers from 5 on.
  constexpr double kLeast = 0.5;
  constexpr double kMost = 3.0;
  detection->trustReadout();
  const auto depth_m = depthsOf(*detection, T_w_c, T_w_m, size_m);
  const MarkerDetection moved = atMidFrame(*detection, camera, twist, depth_m, sigma_s);
  double largest = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    largest = std::max(largest, (moved.normalized[k] - detection->normalized[k]).norm());
  }
  const double sigma = std::sqrt(0.5 * detection->covariance[0].trace());
  if (largest < kLeast * sigma) return;
  const double share = std::min(1.0, kMost * sigma / largest);
  for (std::size_t k = 0; k < 4; ++k) {
    detection->readout_doubt[k] =
        (share * (moved.normalized[k] - detection->normalized[k])).cast<float>();
    const Eigen::Vector2d by = detection->readout_doubt[k].cast<double>();
    detection->covariance[k] += by * by.transpose();
  }
}

bool believable(double estimated_s, double sigma_s, double in_use_s,
                const RollingShutterOptions& options) {
  const double length = std::abs(estimated_s);
  if (length > options.max_s || length < options.min_s) return false;
  if (length < options.min_sigmas * sigma_s) return false;
  return std::abs(estimated_s - in_use_s) > options.min_change_sigmas * sigma_s;
}

}  // namespace waymark::slam
