// A keyframe is as sure of where it was as the markers that say so: a single one far away leaves
// its camera free to swing round it, and what else it saw is off by many times what the corners
// say.
#pragma once

#include "slam/map/map.h"

namespace waymark::slam {

// The detection of a marker with the camera's doubt in the covariances of its corners, as if each
// corner's were its own. The camera's comes from the other markers of the keyframe that have a
// pose. residual_sigma: of the map's whitened residuals. Unchanged where nothing else says where
// the camera was. Precondition: the keyframe sees the marker.
[[nodiscard]] MarkerDetection withCameraDoubt(const Keyframe& keyframe, int marker_id,
                                              double size_m, const Map& map, double residual_sigma);

}  // namespace waymark::slam
