// What a frame shows, by what it is good for, and what has become of it so far.
#pragma once

#include <vector>

#include "slam/frame_time.h"
#include "slam/loop_closure/loop_detector.h"
#include "slam/map/map.h"
#include "slam/tracking/motion_model.h"
#include "slam/tracking/pose_optimizer.h"

namespace waymark::slam {

struct FrameContext {
  FrameTime time;
  std::vector<MarkerDetection> detections;  // usable ones, as at the middle row's time
  SplitMarkers known;                       // pointing into `detections`
  PoseSolution solution;                    // of the eligible markers
  Twist twist = Twist::Zero();
  std::vector<MarkerDetection> fitting;  // those that agree with the pose, sorted by id
  bool closes_loop = false;

  // As a keyframe of what fits.
  [[nodiscard]] Keyframe frameAt(const Transform& T_w_c) const {
    return {-1, time.sequence, time.monotonic_ns, T_w_c, fitting, twist};
  }
};

}  // namespace waymark::slam
