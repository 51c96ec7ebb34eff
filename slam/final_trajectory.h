// Where each frame of a recording is in the map as it is at the end. What a live pose could not
// wait for is there: a single marker's two poses are decided by the frames before and after.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/final_map.h"
#include "slam/no_pose_reason.h"
#include "slam/pose_estimate.h"
#include "slam/tracking/single_marker_sequence.h"

namespace waymark::slam {

class Slam;

struct FinalTrajectoryOptions {
  // The frames are in no order: neighbours say nothing of each other.
  bool unordered_images = false;
  SingleMarkerSequenceOptions single_marker{};
};

struct FinalPose {
  std::optional<PoseEstimate> pose;
  NoPoseReason reason = NoPoseReason::kNone;  // why there is none
};

// One for each frame; empty where the map does not say. One that was lost live is looked for near
// its neighbours. Where the map knows one marker only, the pose is that of the two which the
// sequence decides for; undecided, one whose covariance reaches to the other and whose ambiguity
// ratio is below that of a decided one, or none. Precondition: options.single_marker is valid.
[[nodiscard]] std::vector<FinalPose> localizeAll(std::span<const LiveFrame> frames,
                                                 const FinalTrajectoryOptions& options,
                                                 const Slam& slam);

}  // namespace waymark::slam
