// Where a camera was between markers, once what came after is known: how it moved live, which the
// features knew well, and where the final map has the frames with markers, each with its
// uncertainty. A Kalman filter forwards and a smoother backwards (Rauch, Tung and Striebel, 1965)
// over what the live poses are off by.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/final_map.h"
#include "slam/geometry/transform.h"
#include "slam/pose_estimate.h"

namespace waymark::slam {

struct SmoothedPose {
  Transform T_w_c;
  // Of (dp, dtheta), metres and radians, world frame; relative to the markers.
  Matrix6d covariance = Matrix6d::Zero();
};

// One for each frame with a live pose that is near one with features (some seconds), in a stretch
// of such ones in which the final map places one at least; empty for others. placed: where the map
// has the frames by their markers alone. Precondition: as many as frames.
[[nodiscard]] std::vector<std::optional<SmoothedPose>> smoothTrajectory(
    std::span<const LiveFrame> frames, std::span<const std::optional<PoseEstimate>> placed);

}  // namespace waymark::slam
