#include "slam/feature_stage.h"

#include <algorithm>

namespace waymark::slam {

bool FeatureStage::concerns(const FrameInput& frame) const {
  return options_.enabled && frame.image;
}

bool FeatureStage::follow(const FrameInput& frame, const TrackedFrame& tracked,
                          const PoseEstimate& pose, StageObserver* observer) {
  followed_ = concerns(frame);
  if (!followed_) return true;
  const StageScope scope(observer, Stage::kFeatures);
  fitting_.clear();
  for (std::size_t i = 0; i < tracked.eligible.size(); ++i) {
    if (tracked.solution.inlier[i]) fitting_.push_back(tracked.eligible[i]);
  }
  const bool agrees =
      integrator_.follow(frame.time.monotonic_ns, *frame.image, pose, isCertain(tracked), fitting_);
  if (agrees && !fitting_.empty()) {
    const auto distance_m = [&](const KnownMarker& marker) {
      return (marker.T_w_m.p - pose.T_w_c.p).norm();
    };
    anchor_ = std::ranges::min_element(fitting_, {}, distance_m)->detection->id;
  }
  return agrees;
}

std::optional<PoseEstimate> FeatureStage::inWorld(std::optional<PoseEstimate> pose) const {
  if (pose) pose->covariance += covariance_.sharedAt(pose->T_w_c.p);
  return pose;
}

std::optional<PoseEstimate> FeatureStage::fused() const {
  return followed_ ? inWorld(integrator_.fused()) : std::nullopt;
}

std::optional<PoseEstimate> FeatureStage::bridge(const FrameInput& frame, StageObserver* observer) {
  if (!concerns(frame)) return std::nullopt;
  const StageScope scope(observer, Stage::kFeatures);
  return inWorld(integrator_.bridge(frame.time.monotonic_ns, *frame.image));
}

}  // namespace waymark::slam
