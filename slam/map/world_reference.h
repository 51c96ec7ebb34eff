// What fixes the world of a map: the marker that is to be its origin, or the anchors.
#pragma once

#include "slam/map/map.h"
#include "slam/map/marker_options.h"

namespace waymark::slam {

// Nothing else does: no origin marker is wanted, and no anchor has a place in the map.
[[nodiscard]] bool firstKeyframeIsWorld(const Map& map, const MarkerOptions& markers);

class WorldReference {
 public:
  // The options must outlive it.
  explicit WorldReference(const MarkerOptions& markers) : markers_(markers) {}

  // Whether the origin marker, or every anchor, has had no place in the map yet: until then its
  // world is another than the one asked for. False where the first keyframe fixes it.
  [[nodiscard]] bool isMissing(const Map& map);

 private:
  const MarkerOptions& markers_;
  bool found_ = false;  // for good: the map is moved there once
};

}  // namespace waymark::slam
