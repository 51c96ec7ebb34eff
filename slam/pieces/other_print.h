// One id may hang in two rooms. Its prints look alike; what hangs around them does not.
#pragma once

#include <span>

#include "slam/detection/marker_detection.h"
#include "slam/map/map.h"
#include "slam/pieces/piece_joint.h"

namespace waymark::slam {

// The map knows one marker of those in view only, sees it from about where it has seen it before,
// and of what was around it then and ought to be in the image now nothing is seen: at least two
// markers, or one with another one in its place. Empty detections and unknown markers are no
// reason, and neither is a view from elsewhere: a wall may stand between.
[[nodiscard]] bool isAnotherPrint(const Map& map, std::span<const MarkerDetection> detections,
                                  const JointParts& parts);

}  // namespace waymark::slam
