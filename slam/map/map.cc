#include "slam/map/map.h"

namespace waymark::slam {

std::array<Eigen::Vector3d, 4> MapMarker::cornersInWorld() const {
  std::array<Eigen::Vector3d, 4> corners = markerCorners(size_m);
  for (Eigen::Vector3d& corner : corners) corner = *T_w_m * corner;
  return corners;
}

const MarkerDetection* Keyframe::find(int id) const {
  for (const MarkerDetection& detection : detections) {
    if (detection.id == id) return &detection;
  }
  return nullptr;
}

const MapMarker* Map::find(int id) const {
  const auto found = markers.find(id);
  return found == markers.end() ? nullptr : &found->second;
}

const MapMarker* Map::findPosed(int id) const {
  const MapMarker* marker = find(id);
  return marker != nullptr && marker->T_w_m ? marker : nullptr;
}

}  // namespace waymark::slam
