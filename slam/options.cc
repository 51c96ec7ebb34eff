#include "slam/options.h"

#include <cmath>

#include "base/task.h"

namespace waymark::slam {

void Options::treatAsUnorderedImages() {
  follower.enabled = false;
  tracking.motion.max_age_s = 0.0;
  work_per_frame = kUnlimited;
}

std::string Options::invalidReason() const {
  const auto positive = [](double v) { return std::isfinite(v) && v > 0.0; };
  if (std::string reason = markers.invalidReason(); !reason.empty()) return reason;
  if (!(initialization.ambiguity_ratio >= 1.0) || !(mapper.marker_pose.ambiguity_ratio >= 1.0) ||
      !(tracking.relocalization.ambiguity_ratio >= 1.0)) {
    return "ambiguity ratios must be at least 1";
  }
  if (initialization.attempts < 1) return "initialization needs at least 1 attempt";
  const KeyframeOptions& keyframes = mapper.keyframes;
  if (!positive(keyframes.min_baseline_m) || !positive(keyframes.min_rotation_rad)) {
    return "keyframe distances must be positive";
  }
  if (keyframes.views_per_marker < 2) return "views per marker must be at least 2";
  if (mapper.marker_pose.min_views < 2) return "a marker needs at least 2 views to be resolved";
  return {};
}

}  // namespace waymark::slam
