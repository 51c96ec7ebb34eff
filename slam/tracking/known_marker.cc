#include "slam/tracking/known_marker.h"

namespace waymark::slam {

std::vector<KnownMarker> knownMarkers(const Map& map, std::span<const MarkerDetection> detections) {
  std::vector<KnownMarker> known;
  known.reserve(detections.size());
  for (const MarkerDetection& detection : detections) {
    const MapMarker* marker = map.findPosed(detection.id);
    if (marker == nullptr) continue;
    known.push_back(
        {&detection, *marker->T_w_m, marker->size_m, marker->covariance, marker->cornersInWorld()});
  }
  return known;
}

}  // namespace waymark::slam
