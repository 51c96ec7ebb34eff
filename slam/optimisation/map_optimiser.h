// Local and global optimisation of the map (seed 1, sections 4.7 and 4.10).
#pragma once

#include "slam/map/map.h"
#include "slam/optimisation/bundle_adjuster.h"

namespace waymark::slam {

// Section 4.7: optimises the keyframes that share a marker with the given one (Eq. 30) and the
// markers they see (Eq. 31); other keyframes that see those markers take part, fixed (Eq. 32). The
// first keyframe never moves.
// Precondition: keyframe < map->keyframes.size().
BundleSummary optimiseLocally(Map* map, std::size_t keyframe, const BundleOptions& options);

// Section 4.10: all keyframes but the first, and all posed markers.
BundleSummary optimiseGlobally(Map* map, const BundleOptions& options);

}  // namespace waymark::slam
