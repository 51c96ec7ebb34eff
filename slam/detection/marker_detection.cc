#include "slam/detection/marker_detection.h"

#include <algorithm>

#include "slam/geometry/camera_model.h"

namespace waymark::slam {

std::optional<std::array<Eigen::Vector2d, 4>> undistortCorners(
    const CameraModel& camera, const std::array<Eigen::Vector2d, 4>& pixels) {
  std::array<Eigen::Vector2d, 4> normalised;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto corner = camera.undistort(pixels[k]);
    if (!corner) return std::nullopt;
    normalised[k] = *corner;
  }
  return normalised;
}

bool undistortCorners(const CameraModel& camera, MarkerDetection* detection) {
  const auto normalised = undistortCorners(camera, detection->pixels);
  if (normalised) detection->normalised = *normalised;
  return normalised.has_value();
}

void sortById(std::vector<MarkerDetection>* detections) {
  std::ranges::sort(*detections, {}, &MarkerDetection::id);
}

}  // namespace waymark::slam
