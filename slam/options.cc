#include "slam/options.h"

#include "base/task.h"
#include "slam/option_checks.h"

namespace waymark::slam {

namespace {

std::string twoWorlds(const Options& options) {
  if (!options.markers.origin_marker) return {};
  for (const PicturePrint& print : options.natural.prints) {
    if (!print.T_w_m) continue;
    return "the natural marker \"" + print.name +
           "\" is surveyed, and the origin marker has a world of its own: one of the two";
  }
  return {};
}

}  // namespace

void Options::treatAsUnorderedImages() {
  follower.enabled = false;
  tracking.motion.max_age_s = 0.0;
  tracking.single_marker.min_log_odds = 5.0;  // one image has to do
  natural.enabled = false;
  pieces.begin = false;  // what an image shows may be known when it is tried again
  work_per_frame = kUnlimited;
  lens.agrees_chi2 = 0.0;  // fewer estimates left the map to hang on their order by 0.08 mm
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
      lens.invalidReason(),
      covariance.invalidReason(),
      natural.invalidReason(),
      pieces.invalidReason(),
      twoWorlds(*this),
      global_optimization.invalidReason(),
      intrinsics.invalidReason(),
      firstUnmet({
          {isPositive(work_per_frame), "the work of a frame must be positive"},
          {isShare(spare_time_share), "the share of a slow camera's time must be from 0 to 1"},
          {isPositive(most_work_per_frame), "the most work of a frame must be positive"},
      }),
  });
}

}  // namespace waymark::slam
