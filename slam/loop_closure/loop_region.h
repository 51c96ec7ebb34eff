// The part of a large map that a loop closure moves: what is around the loop, outwards from both of
// its ends.
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "base/task.h"
#include "slam/map/map.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam {

struct LoopRegion {
  SubproblemMembers part;  // moves
  SubproblemMembers rest;  // the other keyframes that see the part's markers: held
  // Of the map when the search began. What is newer belongs to neither of the two.
  KeyframeId newest = -1;
};

// Keyframes around the reference f^omega and around those that see the loop's markers, the nearest
// in the covisibility graph first, until they have `max_views` views of markers together. Empty
// when the two ends are not connected within that part, or there is nothing else than it: then it
// is the whole map that has to be moved. The map may change meanwhile.
Task<std::optional<LoopRegion>> loopRegion(const Map& map, KeyframeId reference,
                                           std::span<const int> loop_markers, std::size_t max_views,
                                           Budget* budget);

// What the rest of the map, which stays where it is, says of the part's markers: a prior for each
// of them, the rest's own normal equations. The part is attached to it that way at the cost of one
// linearization instead of its views in every iteration.
Task<Done> attachToRest(const Map& map, SubproblemMembers rest, const MarkerOptions& markers,
                        double huber, Subproblem* part, Budget* budget);

}  // namespace waymark::slam
