#include "slam/map/world_reference.h"

#include <algorithm>

namespace waymark::slam {

bool firstKeyframeIsWorld(const Map& map, const MarkerOptions& markers) {
  const auto is_missing = [&](int id) { return map.findPosed(id) == nullptr; };
  return !markers.origin_marker && std::ranges::all_of(markers.anchors, is_missing, &Anchor::id);
}

bool WorldReference::isMissing(const Map& map) {
  if (found_) return false;
  const auto is_missing = [&](int id) { return map.findPosed(id) == nullptr; };
  const bool missing = markers_.origin_marker
                           ? is_missing(*markers_.origin_marker)
                           : !markers_.anchors.empty() &&
                                 std::ranges::all_of(markers_.anchors, is_missing, &Anchor::id);
  found_ = !missing;
  return missing;
}

}  // namespace waymark::slam
