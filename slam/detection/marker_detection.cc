#include "slam/detection/marker_detection.h"

#include <algorithm>

#include "slam/geometry/camera_model.h"

namespace waymark::slam {

std::optional<std::array<Eigen::Vector2d, 4>> undistortCorners(
    const CameraModel& camera, const std::array<Eigen::Vector2d, 4>& pixels) {
  std::array<Eigen::Vector2d, 4> normalized;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto corner = camera.undistort(pixels[k]);
    if (!corner) return std::nullopt;
    normalized[k] = *corner;
  }
  return normalized;
}

bool undistortCorners(const CameraModel& camera, MarkerDetection* detection) {
  const auto normalized = undistortCorners(camera, detection->pixels);
  if (normalized) detection->normalized = *normalized;
  return normalized.has_value();
}

void sortById(std::vector<MarkerDetection>* detections) {
  std::ranges::sort(*detections, {}, &MarkerDetection::id);
}

}  // namespace waymark::slam
