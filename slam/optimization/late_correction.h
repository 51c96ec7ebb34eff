// An optimization that took many frames comes into a map that has gone on growing meanwhile.
#pragma once

#include <optional>

#include "slam/map/map.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam {

// As apply(); and what came since moves as what it sees does. newest: keyframe of the map as it was
// when the optimization began, all with a higher number came since. T_of_others, T_new_old: of
// those that see nothing that moves. near_camera: the keyframe that the camera is near, if it may
// have gone elsewhere meanwhile; else it is near the newest one. Where the camera went, T_new_old.
// Precondition: the correction's epoch is the map's.
Transform applyLate(const MapCorrection& correction, KeyframeId newest,
                    const Transform& T_of_others, std::optional<KeyframeId> near_camera, Map* map);

// The same of a correction that has the map's newest keyframe of then: what came since moves as
// the world around that one does, which is where the camera went. Not as what it sees: through
// another lens markers turn, each by itself. Empty, and nothing is done, where the map's
// coordinates are others by now, or nothing is corrected.
std::optional<Transform> applyAllLate(const MapCorrection& correction, Map* map);

}  // namespace waymark::slam
