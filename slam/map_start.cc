#include "slam/map_start.h"

#include <vector>

#include "slam/camera_pose/known_marker.h"
#include "slam/geometry/twist.h"

namespace waymark::slam {

NoPoseReason MapStart::process(std::span<const MarkerDetection> usable, const FrameTime& time) {
  pose_.reset();
  const auto start = initializer_.process(
      {-1, time.sequence, time.monotonic_ns, Transform{}, {usable.begin(), usable.end()}});
  if (!start) return initializer_.reason();
  const Transform T_w_c = with_.updater->begin(*start, with_.map);
  const std::vector<KnownMarker> known = knownMarkers(*with_.map, usable);
  const auto solution = with_.tracker.optimizer().optimize(known, T_w_c);
  if (!solution) return NoPoseReason::kNone;
  pose_ = with_.tracker.estimateOf(*solution, known, Twist::Zero());
  pose_->T_w_c = T_w_c;  // of a keyframe: by definition of the world, or as optimized
  with_.covariance->recover(with_.updater->residualSigma(), with_.map);
  pose_->covariance = with_.covariance->follow(*solution, known);
  return NoPoseReason::kNone;
}

}  // namespace waymark::slam
