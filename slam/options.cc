#include "slam/options.h"

#include "base/task.h"
#include "slam/option_checks.h"

namespace waymark::slam {

void Options::treatAsUnorderedImages() {
  follower.enabled = false;
  tracking.motion.max_age_s = 0.0;
  tracking.single_marker.min_log_odds = 5.0;  // one image has to do
  work_per_frame = kUnlimited;
}

std::string Options::invalidReason() const {
  return firstReason({
      markers.invalidReason(),
      detector.invalidReason(),
      follower.invalidReason(),
      initialization.invalidReason(),
      mapper.keyframes.invalidReason(),
      tracking.single_marker.invalidReason(),
      mapper.local_optimization.invalidReason(),
      loops.invalidReason(),
      screening.invalidReason(),
      shutter.invalidReason(),
      covariance.invalidReason(),
      global_optimization.invalidReason(),
      intrinsics.invalidReason(),
      firstUnmet({
          {mapper.marker_pose.ambiguity_ratio >= 1.0 &&
               tracking.relocalization.ambiguity_ratio >= 1.0,
           "ambiguity ratios must be at least 1"},
          {mapper.marker_pose.min_views >= 2, "a marker needs at least 2 views to be resolved"},
          {isPositive(work_per_frame), "the work of a frame must be positive"},
      }),
  });
}

}  // namespace waymark::slam
