#include "slam/camera_pose/known_marker.h"

#include <memory_resource>
#include <utility>

#include "base/stack_arena.h"
#include "slam/geometry/robust.h"

namespace waymark::slam {

std::vector<KnownMarker> knownMarkers(const Map& map, std::span<const MarkerDetection> detections) {
  std::vector<KnownMarker> known;
  findKnownMarkers(map, detections, &known);
  return known;
}

void findKnownMarkers(const Map& map, std::span<const MarkerDetection> detections,
                      std::vector<KnownMarker>* known) {
  known->clear();
  known->reserve(detections.size());
  for (const MarkerDetection& detection : detections) {
    const MapMarker* marker = map.findPosed(detection.id);
    if (marker == nullptr) continue;
    known->push_back(
        {&detection, *marker->T_w_m, marker->size_m, marker->covariance, marker->cornersInWorld()});
  }
}

std::optional<double> medianDepth(const Map& map, std::span<const MarkerDetection> detections,
                                  const Transform& T_w_c) {
  StackArena<1024> arena;
  std::pmr::vector<double> depths_m(arena.get());
  for (const MarkerDetection& detection : detections) {
    const MapMarker* const marker = map.findPosed(detection.id);
    if (marker != nullptr) depths_m.push_back((marker->T_w_m->p - T_w_c.p).norm());
  }
  if (depths_m.empty()) return std::nullopt;
  return median(std::move(depths_m));
}

}  // namespace waymark::slam
