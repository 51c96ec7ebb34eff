#include "slam/tracking/known_marker.h"

#include <utility>

#include "slam/geometry/robust.h"

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

std::optional<double> medianDepth(std::span<const KnownMarker> markers, const Transform& T_w_c) {
  if (markers.empty()) return std::nullopt;
  std::vector<double> depths_m;
  depths_m.reserve(markers.size());
  for (const KnownMarker& marker : markers) depths_m.push_back((marker.T_w_m.p - T_w_c.p).norm());
  return median(std::move(depths_m));
}

}  // namespace waymark::slam
