// What the markers of a loop say of the frame that closes it (seed 1, section 4.9.1).
#pragma once

#include <span>

#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/loop_closure/loop_closer.h"
#include "slam/relocalization/relocalizer.h"

namespace waymark::slam {

// The frame with those markers of L(t), `loop`, that agree with each other, and gamma-dot^t, where
// they say it is: nowhere, as `expected` then says, when they do not tell. `frame` has the
// detections that fit its pose as tracked.
[[nodiscard]] LoopFrame loopEvidence(Keyframe frame, KeyframeId reference,
                                     std::span<const KnownMarker> loop,
                                     const PoseOptimizer& optimizer, double focal_px,
                                     const RelocalizerOptions& options);

}  // namespace waymark::slam
