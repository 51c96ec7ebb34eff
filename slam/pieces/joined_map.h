// The map that two pieces become: made beside them, in slices, while both stay as they are.
#pragma once

#include "base/task.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/pieces/piece_joint.h"

namespace waymark::slam {

struct JoinedMap {
  Map map;
  KeyframeId newest = -1;  // of those that came from the other piece; -1: none did
};

// `into`, in its own world and with its own keyframes first, and in it `from`, where the joint has
// it. What both know of a marker, the first one knows. Both maps must outlive the task, and stay as
// they are.
Task<JoinedMap> joinMaps(const Map& into, const Map& from, const PieceJoint& joint, Budget* budget);

}  // namespace waymark::slam
