// What is known of a map's markers besides their views, held against these: which of it is
// contradicted, in a line each for people.
#pragma once

#include <string>
#include <vector>

#include "slam/covariance/constraint_information.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"

namespace waymark::slam {

// Of every position, member of a plane, upright marker and distance that the map has, and of the
// anchors; the map as it is, at once.
[[nodiscard]] std::vector<ConstraintResidual> constraintResiduals(const Map& map,
                                                                  const MarkerOptions& options);

// "marker 12: 5.3 sigmas from plane \"north\"".
[[nodiscard]] std::string constraintText(const ConstraintResidual& residual,
                                         const MarkerOptions& options);

// Those of all pieces that are beyond the gate (MarkerConstraints::gate_sigmas), the farthest
// first.
[[nodiscard]] std::vector<ConstraintResidual> contradictions(const std::vector<const Map*>& pieces,
                                                             const MarkerOptions& options);

// The first of them, and how many more there are: a plane of hundreds, said wrongly, fills no log.
[[nodiscard]] std::vector<std::string> contradictionLines(
    const std::vector<ConstraintResidual>& found, const MarkerOptions& options);

}  // namespace waymark::slam
