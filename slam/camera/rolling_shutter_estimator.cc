#include "slam/camera/rolling_shutter_estimator.h"

#include "slam/camera/undistort_map.h"
#include "slam/optimization/map_optimizer.h"

namespace waymark::slam {
namespace {

// While the shutter is not known well, the views that speak loudest of it fit worst.
BundleOptions ungated(BundleOptions options) {
  options.view_chi2 = 0.0;
  return options;
}

}  // namespace

void RollingShutterEstimator::deskew(const CameraModel& camera, const Map& map,
                                     const Transform& T_w_c, const Twist& twist,
                                     std::vector<MarkerDetection>* detections) const {
  if (seconds_ == 0.0) return;
  for (MarkerDetection& detection : *detections) {
    const MapMarker* marker = map.find(detection.id);
    const auto better =
        deskewed(detection, camera, T_w_c, twist, marker != nullptr ? marker->T_w_m : std::nullopt,
                 markers_.sizeOf(detection.id), seconds_);
    if (better) detection = *better;
  }
}

bool RollingShutterEstimator::isDue(const Map& map) const {
  return !shutter_.readout_s && static_cast<int>(map.keyframes().size()) >= next_keyframes_;
}

void RollingShutterEstimator::work(double cost, const CameraModel& camera, const Map& map,
                                   const BundleOptions& optimization) {
  if (!estimate_ && !whole_ && isDue(map)) {
    next_keyframes_ =
        static_cast<int>(shutter_.growth * static_cast<double>(map.keyframes().size())) + 1;
    estimate_.emplace([&](Budget* budget) {
      return estimateReadout(map, markers_, seconds_, camera, shutter_.max_keyframes,
                             ungated(optimization), budget);
    });
  }
  if (estimate_) (void)estimate_->advance(cost);
  if (whole_) (void)whole_->advance(cost);
}

std::optional<Transform> RollingShutterEstimator::collect(const CameraModel& camera,
                                                          const BundleOptions& optimization,
                                                          Map* map) {
  if (estimate_ && estimate_->done()) {
    if (!adopt(camera, map)) return std::nullopt;
    whole_.emplace([&](Budget* budget) {
      return optimizeSubproblem(*map, wholeMap(*map), markers_, ungated(optimization), budget);
    });
    return Transform{};
  }
  if (!isDone()) return std::nullopt;
  const MapCorrection correction = whole_->take();
  whole_.reset();
  return applyWhole(correction, map);
}

// Whether the estimate is believed.
bool RollingShutterEstimator::adopt(const CameraModel& camera, Map* map) {
  const std::optional<ReadoutEstimate> found = estimate_->take();
  estimate_.reset();
  if (!found || !believable(found->readout_s, found->sigma_s, seconds_, shutter_)) return false;
  seconds_ = found->readout_s;
  undistortAgain(camera, seconds_, map);
  return true;
}

}  // namespace waymark::slam
