#include "daemon/frames/map_snapshot.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace waymark::daemon {
namespace {

// Several pieces may have seen a marker that one of them, or none, has a place for.
void tellUnposedOnce(MapSnapshot* snapshot) {
  std::vector<MapSnapshot::Unposed>& unposed = snapshot->unposed;
  std::erase_if(unposed, [&](const MapSnapshot::Unposed& marker) {
    return std::ranges::find(snapshot->markers, marker.id, &MapSnapshot::Marker::id) !=
           snapshot->markers.end();
  });
  std::ranges::sort(unposed, [](const auto& a, const auto& b) {
    return std::pair(a.id, -a.views) < std::pair(b.id, -b.views);
  });
  const auto twice = std::ranges::unique(unposed, {}, &MapSnapshot::Unposed::id);
  unposed.erase(twice.begin(), twice.end());
}

void addTo(MapSnapshot* snapshot, const slam::Map& piece) {
  snapshot->keyframe_count += static_cast<int>(piece.keyframes().size());
  for (const auto& [id, marker] : piece.markers()) {
    const int views = static_cast<int>(piece.viewsOf(id).size());
    if (!marker.T_w_m) {
      if (!slam::isPicture(id)) {
        snapshot->unposed.push_back({id, marker.size_m, marker.state, views});
      }
      continue;
    }
    auto& of_its_kind = slam::isPicture(id) ? snapshot->pictures : snapshot->markers;
    of_its_kind.push_back({id, marker.size_m, *marker.T_w_m, marker.world_covariance,
                           marker.other_T_w_m.has_value(), views, piece.piece});
  }
}

}  // namespace

void fillSnapshot(std::span<const slam::Map* const> pieces, MapSnapshot* snapshot) {
  snapshot->keyframe_count = 0;
  snapshot->markers.clear();
  snapshot->pictures.clear();
  snapshot->unposed.clear();
  for (const slam::Map* const piece : pieces) addTo(snapshot, *piece);
  if (pieces.size() > 1) tellUnposedOnce(snapshot);
}

}  // namespace waymark::daemon
