#include "slam/keyframes/keyframe_culler.h"

#include <algorithm>
#include <cstddef>

#include "slam/keyframes/farthest_views.h"

namespace waymark::slam {

int KeyframeCuller::cull(Map* map, KeyframeId newest) {
  int removed = 0;
  for (const KeyframeId id : map->neighbours(newest)) {
    if (id == newest || isWanted(*map, id, newest)) continue;
    map->removeKeyframe(id);
    ++removed;
  }
  return removed;
}

// What is linked to a keyframe may hang on nothing else.
bool KeyframeCuller::isWanted(const Map& map, KeyframeId keyframe, KeyframeId newest) {
  if (keyframe == map.keyframes().begin()->first) return true;
  const Keyframe& known = map.keyframes().at(keyframe);
  return !known.links.empty() ||
         std::ranges::any_of(known.detections, [&](const MarkerDetection& detection) {
           return chooses(map, detection.id, keyframe, newest);
         });
}

bool KeyframeCuller::chooses(const Map& map, int marker, KeyframeId view, KeyframeId newest) {
  Choice& choice = choices_[marker];
  if (choice.looked_at != newest) {
    choice.looked_at = newest;
    const auto views = map.viewsOf(marker);
    if (choice.newest_view != views.back() || !std::ranges::includes(views, choice.views)) {
      ViewArena arena;
      const auto count = static_cast<std::size_t>(options_.views_per_marker);
      choice.newest_view = views.back();
      choice.views.clear();
      for (const std::size_t i : farthestViews(viewPositions(map, views, &arena), count, &arena)) {
        choice.views.push_back(views[i]);
      }
      std::ranges::sort(choice.views);
    }
  }
  return std::ranges::binary_search(choice.views, view);
}

}  // namespace waymark::slam
