// How well a whole map explains what its keyframes saw.
#pragma once

#include "slam/optimization/map_fit.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam::testing {

inline MapFit wholeMapFit(const Map& map) {
  const MarkerOptions markers;
  const Subproblem part =
      runToCompletion([&](Budget* a) { return buildSubproblem(map, wholeMap(map), markers, a); });
  return runToCompletion([&](Budget* a) { return fitOf(part.problem, a); });
}

// Its robust cost, with the usual kernel.
inline double costOf(const MapFit& fit) {
  constexpr double kHuber = 2.45;
  return runToCompletion([&](Budget* a) { return slam::costOf(fit.squared, kHuber, a); });
}

}  // namespace waymark::slam::testing
