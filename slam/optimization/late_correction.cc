#include "slam/optimization/late_correction.h"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "slam/geometry/mean_transform.h"

namespace waymark::slam {
namespace {

// What becomes of poses, T_new_old: of the markers, and of the keyframes that came since. What is
// not in it stays where it is, or is in the correction.
struct Motions {
  std::vector<std::pair<int, Transform>> of_corrected;         // markers, ascending
  std::map<int, Transform> of_others;                          // markers that came since
  std::vector<std::pair<KeyframeId, Transform>> of_keyframes;  // ascending

  [[nodiscard]] const Transform* find(int marker) const {
    const auto corrected =
        std::ranges::lower_bound(of_corrected, marker, {}, &std::pair<int, Transform>::first);
    if (corrected != of_corrected.end() && corrected->first == marker) return &corrected->second;
    const auto other = of_others.find(marker);
    return other == of_others.end() ? nullptr : &other->second;
  }
};

// Of the markers that hang where they did when the optimization began.
Motions motionsOf(const MapCorrection& correction, const Map& map) {
  Motions motions;
  motions.of_corrected.reserve(correction.markers.size());
  for (const auto& corrected : correction.markers) {
    const MapMarker* const known = findUnmoved(map, corrected.marker);
    if (known == nullptr) continue;
    motions.of_corrected.emplace_back(known->id, corrected.T_w_m * known->T_w_m->inverse());
  }
  return motions;
}

// A keyframe that came since moves as the markers do that it sees, on average; one that sees none
// that move goes with the others. Markers that are new move as the first keyframe does that sees
// them.
void addWhatCameSince(KeyframeId newest, const Transform& T_of_others, const Map& map,
                      Motions* motions) {
  std::vector<Transform> ends;
  std::vector<int> perhaps_new;
  for (auto it = map.keyframes().upper_bound(newest); it != map.keyframes().end(); ++it) {
    const auto& [id, keyframe] = *it;
    ends.clear();
    perhaps_new.clear();
    for (const MarkerDetection& detection : keyframe.detections) {
      if (const Transform* const motion = motions->find(detection.id)) {
        ends.push_back(*motion * keyframe.T_w_c);
      } else {
        perhaps_new.push_back(detection.id);
      }
    }
    const Transform T_new_old =
        ends.empty() ? T_of_others : meanTransform(ends) * keyframe.T_w_c.inverse();
    motions->of_keyframes.emplace_back(id, T_new_old);
    for (const int marker : perhaps_new) {
      if (map.viewsOf(marker).front() > newest) motions->of_others.emplace(marker, T_new_old);
    }
  }
}

// All of them move as one.
void addTogether(KeyframeId newest, const Transform& T_new_old, const Map& map, Motions* motions) {
  for (auto it = map.keyframes().upper_bound(newest); it != map.keyframes().end(); ++it) {
    const auto& [id, keyframe] = *it;
    motions->of_keyframes.emplace_back(id, T_new_old);
    for (const MarkerDetection& detection : keyframe.detections) {
      const bool is_new = map.viewsOf(detection.id).front() > newest;
      if (is_new && motions->find(detection.id) == nullptr) {
        motions->of_others.emplace(detection.id, T_new_old);
      }
    }
  }
}

// Of a keyframe; empty for one that stays, or is gone.
std::optional<Transform> motionOf(KeyframeId id, const MapCorrection& correction,
                                  const Motions& motions, const Map& map) {
  const auto since = std::ranges::lower_bound(motions.of_keyframes, id, {},
                                              &std::pair<KeyframeId, Transform>::first);
  if (since != motions.of_keyframes.end() && since->first == id) return since->second;
  const auto corrected = std::ranges::lower_bound(correction.keyframes, id, {}, &KeyframePose::id);
  const auto known = map.keyframes().find(id);
  if (corrected == correction.keyframes.end() || corrected->id != id) return std::nullopt;
  if (known == map.keyframes().end()) return std::nullopt;
  return corrected->T_w_c * known->second.T_w_c.inverse();
}

// Markers that were given a pose since, by keyframes that were there.
void addPosedSince(const MapCorrection& correction, const Map& map, Motions* motions) {
  for (const auto& [id, marker] : map.markers()) {
    if (!marker.T_w_m || motions->find(id) != nullptr || map.viewsOf(id).empty()) continue;
    const auto motion = motionOf(map.viewsOf(id).front(), correction, *motions, map);
    if (motion) motions->of_others.emplace(id, *motion);
  }
}

void moveMarker(int id, const Transform& T_new_old, Map* map) {
  const MapMarker* const marker = map->findPosed(id);
  if (marker == nullptr) return;
  const auto other =
      marker->other_T_w_m ? std::optional(T_new_old * *marker->other_T_w_m) : std::nullopt;
  map->place(id, T_new_old * *marker->T_w_m, other, marker->covariance);
}

void move(const Motions& motions, Map* map) {
  for (const auto& [id, T_new_old] : motions.of_keyframes) {
    map->setKeyframePose(id, T_new_old * map->keyframes().at(id).T_w_c);
  }
  for (const auto& [id, T_new_old] : motions.of_corrected) {
    // The others are given their poses by the correction itself.
    if (map->find(id)->other_T_w_m) moveMarker(id, T_new_old, map);
  }
  for (const auto& [id, T_new_old] : motions.of_others) moveMarker(id, T_new_old, map);
}

}  // namespace

Transform applyLate(const MapCorrection& correction, KeyframeId newest,
                    const Transform& T_of_others, std::optional<KeyframeId> near_camera, Map* map) {
  Motions motions = motionsOf(correction, *map);
  addWhatCameSince(newest, T_of_others, *map, &motions);
  addPosedSince(correction, *map, &motions);
  const auto T_of_camera =
      near_camera ? motionOf(*near_camera, correction, motions, *map) : std::nullopt;
  move(motions, map);
  (void)apply(correction, map);  // exactly
  if (T_of_camera) return *T_of_camera;
  return motions.of_keyframes.empty() ? T_of_others : motions.of_keyframes.back().second;
}

std::optional<Transform> applyAllLate(const MapCorrection& correction, Map* map) {
  if (correction.epoch != map->epoch() || correction.keyframes.empty()) return std::nullopt;
  const KeyframeId newest = correction.keyframes.back().id;
  const Transform T_new_old = motionAround(newest, correction, *map);
  Motions motions = motionsOf(correction, *map);
  addTogether(newest, T_new_old, *map, &motions);
  addPosedSince(correction, *map, &motions);
  move(motions, map);
  (void)apply(correction, map);
  return T_new_old;
}

}  // namespace waymark::slam
