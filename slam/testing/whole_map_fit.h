// How well a whole map explains what its keyframes saw.
#pragma once

#include "slam/optimisation/map_fit.h"
#include "slam/optimisation/map_part.h"

namespace waymark::slam::testing {

inline MapFit wholeMapFit(const Map& map) {
  const MarkerOptions markers;
  const MapPart part =
      inOneGo([&](Allowance* a) { return takePart(map, wholeMap(map), markers, a); });
  return inOneGo([&](Allowance* a) { return fitOf(part.problem, a); });
}

}  // namespace waymark::slam::testing
