#include "simulator/observed_corners.h"

#include <algorithm>

#include <Eigen/LU>

#include "simulator/projected_marker.h"
#include "simulator/random.h"

namespace waymark::simulator {
namespace {

// Without noise. Empty when the marker is not wholly in view.
std::optional<slam::MarkerDetection> seen(const slam::CameraModel& camera,
                                          const slam::Transform& T_w_c, const Marker& marker) {
  const slam::Transform T_c_m = T_w_c.inverse() * marker.T_w_m;
  const bool in_front = T_c_m.p.z() > 0.0;
  const bool faces_us = T_c_m.R.col(2).dot(T_c_m.p) < 0.0;
  if (!in_front || !faces_us) return std::nullopt;
  const std::optional<ImageCorners> pixels = projectMarker(camera, T_c_m, marker.size_m);
  const auto in_image = [&](const Eigen::Vector2d& pixel) { return camera.inImage(pixel); };
  if (!pixels || !std::ranges::all_of(*pixels, in_image)) return std::nullopt;
  slam::MarkerDetection detection;
  detection.id = marker.id;
  detection.pixels = *pixels;
  return detection;
}

// False when a corner has left the lens's range.
bool disturb(const slam::CameraModel& camera, double sigma_px, Random* random,
             slam::MarkerDetection* detection) {
  for (std::size_t k = 0; k < 4; ++k) {
    const double dx = random->gaussian();
    const double dy = random->gaussian();
    detection->pixels[k] += sigma_px * Eigen::Vector2d(dx, dy);
    const auto normalized = camera.undistort(detection->pixels[k]);
    if (!normalized) return false;
    detection->normalized[k] = *normalized;
    Eigen::Matrix2d J;  // pixel by normalized
    static_cast<void>(camera.distort(*normalized, &J));
    detection->covariance[k] = sigma_px * sigma_px * (J.transpose() * J).inverse();
  }
  return true;
}

}  // namespace

std::vector<slam::MarkerDetection> observeCorners(const slam::CameraModel& camera,
                                                  const slam::Transform& T_w_c,
                                                  std::span<const Marker> markers,
                                                  std::uint64_t frame,
                                                  const ObservationOptions& options) {
  Random random(options.seed, frame);
  std::vector<slam::MarkerDetection> detections;
  for (const Marker& marker : markers) {
    std::optional<slam::MarkerDetection> detection = seen(camera, T_w_c, marker);
    if (detection && disturb(camera, options.sigma_px, &random, &*detection)) {
      detections.push_back(*detection);
    }
  }
  slam::sortById(&detections);
  return detections;
}

}  // namespace waymark::simulator
