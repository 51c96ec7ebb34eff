#include "slam/options.h"

#include "base/task.h"
#include "slam/option_checks.h"

namespace waymark::slam {

void Options::treatAsUnorderedImages() {
  follower.enabled = false;
  tracking.motion.max_age_s = 0.0;
  tracking.single_marker.min_log_odds = 5.0;  // one image has to do
  natural.enabled = false;
  work_per_frame = kUnlimited;
}

std::string Options::invalidReason() const {
  return firstReason({
      markers.invalidReason(),
      detector.invalidReason(),
      follower.invalidReason(),
      initialization.invalidReason(),
      tracking.invalidReason(),
      mapper.invalidReason(),
      loops.invalidReason(),
      screening.invalidReason(),
      shutter.invalidReason(),
      covariance.invalidReason(),
      natural.invalidReason(),
      global_optimization.invalidReason(),
      intrinsics.invalidReason(),
      firstUnmet({
          {isPositive(work_per_frame), "the work of a frame must be positive"},
      }),
  });
}

}  // namespace waymark::slam
