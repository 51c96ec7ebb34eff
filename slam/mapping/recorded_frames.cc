#include "slam/mapping/recorded_frames.h"

#include <map>
#include <utility>
#include <vector>

namespace waymark::slam {

std::optional<LocatedFrame> RecordedFrameLocator::locate(const Map& map,
                                                         const RecordedFrame& frame) const {
  LocatedFrame located;
  located.detections = screening_.usable(frame.detections, camera_, map);
  rolling_shutter_.deskew(camera_, map, frame.T_w_c, frame.twist, &located.detections);
  located.known = knownMarkers(map, located.detections);
  auto solution = tracker_.locate(located.known, frame.T_w_c);
  if (!solution) return std::nullopt;
  located.solution = std::move(*solution);
  return located;
}

std::optional<FrameOfOneMarker> RecordedFrameLocator::locateByOneMarker(
    const Map& map, const RecordedFrame& frame, const SquarePoseOptions& square) const {
  FrameOfOneMarker located;
  located.detections = screening_.usable(frame.detections, camera_, map);
  rolling_shutter_.deskew(camera_, map, frame.T_w_c, frame.twist, &located.detections);
  located.known = knownMarkers(map, located.detections);
  if (located.known.size() != 1) return std::nullopt;
  const KnownMarker& marker = located.known.front();
  const auto view = viewSingleMarker(marker, tracker_.focalLength(), square);
  if (!view) return std::nullopt;
  located.view = *view;
  for (std::size_t i = 0; i < 2; ++i) {
    auto solution = tracker_.optimizer().optimize(located.known, marker.T_w_m * view->T_m_c[i]);
    if (!solution || !tracker_.optimizer().acceptable(*solution)) return std::nullopt;
    located.solutions[i] = std::move(*solution);
  }
  return located;
}

void RecordedFrameLocator::densify(std::span<const RecordedFrame> frames, KeyframeId last_old,
                                   Map* map) const {
  std::map<std::int64_t, KeyframeId> in_map;  // by time
  for (const auto& [id, keyframe] : map->keyframes()) {
    if (id > last_old) in_map[keyframe.monotonic_ns] = id;
  }
  for (const RecordedFrame& frame : frames) {
    auto view = viewOf(frame, *map);
    if (!view) continue;
    const auto known = in_map.find(frame.monotonic_ns);
    if (known == in_map.end()) {
      (void)map->addKeyframe(std::move(*view));
      continue;
    }
    for (const MarkerDetection& detection : view->detections) {
      const Keyframe& keyframe = map->keyframes().at(known->second);
      if (keyframe.find(detection.id) == nullptr) map->addView(keyframe.id, detection);
    }
  }
}

std::optional<Keyframe> RecordedFrameLocator::viewOf(const RecordedFrame& frame,
                                                     const Map& map) const {
  const auto located = locate(map, frame);
  if (!located) return std::nullopt;
  std::vector<MarkerDetection> seen;
  for (std::size_t i = 0; i < located->known.size(); ++i) {
    if (located->solution.inlier[i]) seen.push_back(*located->known[i].detection);
  }
  for (const MarkerDetection& detection : located->detections) {
    const MapMarker* const marker = map.find(detection.id);
    if (marker != nullptr && !marker->T_w_m) seen.push_back(detection);
  }
  sortById(&seen);
  return Keyframe{
      -1,         frame.sequence, frame.monotonic_ns, located->solution.T_w_c, std::move(seen),
      frame.twist};
}

}  // namespace waymark::slam
