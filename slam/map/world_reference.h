// What fixes the world of a map: the marker that is to be its origin, or what is surveyed.
#pragma once

#include "slam/map/map.h"
#include "slam/map/marker_options.h"

namespace waymark::slam {

// Surveyed positions (MarkerConstraints::positions) of markers with a place fix the world: three or
// more, and not so near to a line that the map could turn about it.
[[nodiscard]] bool positionsFixWorld(const Map& map, const MarkerOptions& markers);
// The world is that of the anchors and positions, as one of the two has come to fix it.
[[nodiscard]] bool isInSurvey(const Map& map, const MarkerOptions& markers);
// What takes the map there, by the positions. Precondition: they fix it.
[[nodiscard]] Transform surveyedFromMap(const Map& map, const MarkerOptions& markers);

// How well what is surveyed says where the map is: of (dp, dtheta) of all of it, metres and
// radians. Precondition: it is in the survey.
[[nodiscard]] Matrix6d surveyCovariance(const Map& map, const MarkerOptions& markers);

// Nothing else does: no origin marker is wanted, and nothing surveyed has a place in the map.
[[nodiscard]] bool firstKeyframeIsWorld(const Map& map, const MarkerOptions& markers);

class WorldReference {
 public:
  // The options must outlive it.
  explicit WorldReference(const MarkerOptions& markers) : markers_(markers) {}

  // Whether the origin marker, or what is surveyed, has had no place in the map yet: until then its
  // world is another than the one asked for. False where the first keyframe fixes it.
  [[nodiscard]] bool isMissing(const Map& map);

 private:
  const MarkerOptions& markers_;
  bool found_ = false;  // for good: the map is moved there once
};

}  // namespace waymark::slam
