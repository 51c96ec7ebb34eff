#include "slam/camera/rolling_shutter_estimator.h"

#include <algorithm>
#include <cmath>

#include "slam/camera/undistort_map.h"
#include "slam/optimization/map_optimizer.h"

namespace waymark::slam {
namespace {

// How well the readout time is known that a run begins with. One that was learned before had to be
// so many of its standard deviations long.
double sigmaAtTheStart(const RollingShutterOptions& shutter) {
  if (shutter.readout_s) return 0.0;
  if (shutter.learned_s == 0.0) return shutter.unknown_s;
  return std::min(shutter.unknown_s, std::abs(shutter.learned_s) / shutter.min_sigmas);
}

// The map's corners as a camera with this readout time, which is known, has seen them.
void seeWith(double readout_s, const CameraModel& camera, Map* map) {
  undistortAgain(camera, readout_s, map);
  trustReadout(map);
}

}  // namespace

RollingShutterEstimator::RollingShutterEstimator(const RollingShutterOptions& shutter,
                                                 const MarkerOptions& markers)
    : shutter_(shutter),
      markers_(markers),
      seconds_(shutter.readout_s.value_or(shutter.learned_s)),
      sigma_s_(sigmaAtTheStart(shutter)),
      estimated_(shutter.readout_s || shutter.learned_s != 0.0),
      next_keyframes_(shutter.first_keyframes) {}

void RollingShutterEstimator::deskew(const CameraModel& camera, const Map& map,
                                     const Transform& T_w_c, const Twist& twist,
                                     std::vector<MarkerDetection>* detections) const {
  const double doubt_s = this->doubt_s(map);
  if (seconds_ == 0.0 && doubt_s == 0.0) return;
  for (MarkerDetection& detection : *detections) {
    const MapMarker* marker = map.find(detection.id);
    const auto T_w_m = marker != nullptr ? marker->T_w_m : std::nullopt;
    const double size_m = markers_.sizeOf(detection.id);
    if (seconds_ != 0.0) {
      const auto better = deskewed(detection, camera, T_w_c, twist, T_w_m, size_m, seconds_);
      if (better) detection = *better;
    }
    if (doubt_s != 0.0) {
      doubtReadout(camera, T_w_c, twist, T_w_m, size_m, doubt_s, &detection);
    }
  }
}

void RollingShutterEstimator::deskew(const CameraModel& camera, KeyframeId keyframe,
                                     Map* map) const {
  if (seconds_ != 0.0) undistortAgain(camera, seconds_, keyframe, map);
  if (const double sigma_s = doubt_s(*map); sigma_s != 0.0) {
    doubtReadout(camera, sigma_s, keyframe, map);
  }
}

double RollingShutterEstimator::doubt_s(const Map& map) const {
  const bool is_small = static_cast<int>(map.keyframes().size()) < shutter_.first_keyframes;
  return !estimated_ && (is_small || estimate_ || whole_) ? sigma_s_ : 0.0;
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
    if (const auto news = takeNews(*map)) beginWhole(*news, camera, optimization, *map);
    return std::nullopt;
  }
  if (!isDone()) return std::nullopt;
  const ReadoutEstimate readout = adoption_->readout;
  if (adoption_->epoch != map->epoch()) {  // of a world that is no more
    beginWhole(readout, camera, optimization, *map);
    return std::nullopt;
  }
  const MapCorrection correction = whole_->take();
  whole_.reset();
  adoption_.reset();
  seconds_ = readout.readout_s;
  sigma_s_ = readout.sigma_s;
  seeWith(seconds_, camera, map);
  estimated_ = true;
  return applyWhole(correction, map);
}

void RollingShutterEstimator::beginWhole(const ReadoutEstimate& readout, const CameraModel& camera,
                                         const BundleOptions& optimization, const Map& map) {
  whole_.reset();
  adoption_ = Adoption{readout, map.epoch(), map};
  const Map& seen = adoption_->map;
  seeWith(readout.readout_s, camera, &adoption_->map);
  whole_.emplace([&](Budget* budget) {
    return optimizeSubproblem(seen, wholeMap(seen), markers_, ungated(optimization), budget);
  });
}

std::optional<ReadoutEstimate> RollingShutterEstimator::takeNews(const Map& map) {
  const std::optional<ReadoutEstimate> found = estimate_->take();
  estimate_.reset();
  if (found && believable(found->readout_s, found->sigma_s, seconds_, shutter_)) return found;
  if (found) {
    const double off_s = found->readout_s - seconds_;
    sigma_s_ = std::min(shutter_.unknown_s, std::hypot(off_s, found->sigma_s));
  }
  if (isDoubted(map)) return ReadoutEstimate{seconds_, sigma_s_};
  estimated_ = true;
  return std::nullopt;
}

}  // namespace waymark::slam
