// Images in no order: the map that grows from them must not depend on the order of their files.
// Beyond seed 1, which has a camera's frames.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/final_map.h"
#include "slam/frame.h"
#include "slam/slam.h"

namespace waymark::slam {

// What became of a frame.
struct Placement {
  TrackingState state = TrackingState::kInitializing;
  NoPoseReason reason = NoPoseReason::kNone;
  std::optional<PoseEstimate> pose{};
};

// The map is begun anew, with what is known of the lens by now: from the image that shows most of
// what others show, too; then always with the one that shows most of what the map knows. One that
// found no place is given again once more of it is known; those that show nothing of the map begin
// pieces of their own in the end. By frame. Preconditions: Options::treatAsUnorderedImages(), and
// the SLAM was not given a map.
[[nodiscard]] std::vector<Placement> placeInOrder(std::span<const LiveFrame> frames, Slam* slam);

}  // namespace waymark::slam
