// A loop that was closed comes into the map, which has gone on growing meanwhile.
#pragma once

#include <optional>

#include "slam/loop_closure/loop_closer.h"
#include "slam/map/map.h"

namespace waymark::slam {

struct AdoptedLoop {
  KeyframeId closing = -1;  // the closing frame's
  bool added = false;       // else it had become a keyframe by itself
  Transform T_new_old;      // what became of where the camera is
};

// Corrects the map, and adds the closing frame to it, unless it has become a
// keyframe by itself. What came since the closing began moves as
// what it sees, and the camera as the newest keyframe; where it was lost meanwhile, and may be
// elsewhere, as the keyframe that it is near by now. Empty, and nothing is done, when the map's
// coordinates are others by now.
[[nodiscard]] std::optional<AdoptedLoop> adopt(const ClosedLoop& loop,
                                               std::optional<KeyframeId> near_camera, Map* map);

// The same without a closing frame: what became of where the camera is.
[[nodiscard]] std::optional<Transform> adopt(const RelaxedMap& relaxed,
                                             std::optional<KeyframeId> near_camera, Map* map);

}  // namespace waymark::slam
