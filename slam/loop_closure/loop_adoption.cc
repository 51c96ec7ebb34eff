#include "slam/loop_closure/loop_adoption.h"

#include <algorithm>

#include "slam/optimization/late_correction.h"

namespace waymark::slam {
namespace {

// Whether both are of one frame. Recordings need not have times, nor sequences of their own: what
// was seen decides.
bool isSameFrame(const Keyframe& a, const Keyframe& b) {
  if (a.sequence != b.sequence || a.monotonic_ns != b.monotonic_ns) return false;
  return std::ranges::any_of(a.detections, [&](const MarkerDetection& seen) {
    const MarkerDetection* const other = b.find(seen.id);
    return other != nullptr && other->pixels == seen.pixels;
  });
}

// The closing frame may have become a keyframe by itself, without the loop's markers: often before
// the closing first looked at the map.
std::optional<KeyframeId> keyframeOf(const Keyframe& frame, const Map& map) {
  const auto& keyframes = map.keyframes();
  for (auto it = keyframes.rbegin(); it != keyframes.rend(); ++it) {
    if (it->second.monotonic_ns < frame.monotonic_ns) break;
    if (isSameFrame(frame, it->second)) return it->first;
  }
  return std::nullopt;
}

// What it sees of the map's markers, where it belongs.
void addClosing(const ClosedLoop& loop, Map* map, AdoptedLoop* adopted) {
  Keyframe closing = loop.closing;
  closing.detections.change([&](auto* detections) {
    std::erase_if(*detections,
                  [&](const MarkerDetection& d) { return map->find(d.id) == nullptr; });
  });
  const auto itself = keyframeOf(closing, *map);
  adopted->added = !itself;
  adopted->closing = itself ? *itself : map->addKeyframe(closing);
  if (!itself) return;
  map->setKeyframePose(*itself, closing.T_w_c);
  for (const MarkerDetection& seen : closing.detections) {
    if (map->keyframes().at(*itself).find(seen.id) == nullptr) map->addView(*itself, seen);
  }
}

}  // namespace

std::optional<AdoptedLoop> adopt(const ClosedLoop& loop, std::optional<KeyframeId> near_camera,
                                 Map* map) {
  if (loop.correction.epoch != map->epoch()) return std::nullopt;
  const Transform T_with_closing = loop.closing.T_w_c * loop.T_w_tracked.inverse();
  AdoptedLoop adopted;
  adopted.T_new_old = applyLate(loop.correction, loop.newest, T_with_closing, near_camera, map);
  map->beginEpoch();
  addClosing(loop, map, &adopted);
  return adopted;
}

std::optional<Transform> adopt(const RelaxedMap& relaxed, std::optional<KeyframeId> near_camera,
                               Map* map) {
  const MapCorrection& correction = relaxed.correction;
  if (correction.epoch != map->epoch() || correction.keyframes.empty()) return std::nullopt;
  const auto last = map->keyframes().find(correction.keyframes.back().id);
  const Transform T_of_last = last == map->keyframes().end() ? Transform{}
                                                             : correction.keyframes.back().T_w_c *
                                                                   last->second.T_w_c.inverse();
  const Transform T_new_old = applyLate(correction, relaxed.newest, T_of_last, near_camera, map);
  map->beginEpoch();
  return T_new_old;
}

}  // namespace waymark::slam
