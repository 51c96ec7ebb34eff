#include "slam/detection/marker_detection.h"

#include <algorithm>

#include "slam/geometry/camera_model.h"

namespace waymark::slam {

bool undistortCorners(const CameraModel& camera, MarkerDetection* detection) {
  std::array<Eigen::Vector2d, 4> normalised = detection->normalised;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto corner = camera.undistort(detection->pixels[k]);
    if (!corner) return false;
    normalised[k] = *corner;
  }
  detection->normalised = normalised;
  return true;
}

void sortById(std::vector<MarkerDetection>* detections) {
  std::stable_sort(detections->begin(), detections->end(),
                   [](const MarkerDetection& a, const MarkerDetection& b) { return a.id < b.id; });
}

}  // namespace waymark::slam
