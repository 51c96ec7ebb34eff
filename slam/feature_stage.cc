#include "slam/feature_stage.h"

namespace waymark::slam {

bool FeatureStage::concerns(const FrameInput& frame) const {
  return options_.enabled && frame.image;
}

bool FeatureStage::follow(const FrameInput& frame, const TrackedFrame& tracked,
                          const PoseEstimate& pose, StageObserver* observer) {
  if (!concerns(frame)) return true;
  const StageScope scope(observer, Stage::kFeatures);
  fitting_.clear();
  for (std::size_t i = 0; i < tracked.eligible.size(); ++i) {
    if (tracked.solution.inlier[i]) fitting_.push_back(tracked.eligible[i]);
  }
  return integrator_.follow(frame.time.monotonic_ns, *frame.image, pose, isCertain(tracked),
                            fitting_);
}

std::optional<PoseEstimate> FeatureStage::bridge(const FrameInput& frame, StageObserver* observer) {
  if (!concerns(frame)) return std::nullopt;
  const StageScope scope(observer, Stage::kFeatures);
  auto pose = integrator_.bridge(frame.time.monotonic_ns, *frame.image);
  if (pose) pose->covariance += covariance_.sharedAt(pose->T_w_c.p);
  return pose;
}

}  // namespace waymark::slam
