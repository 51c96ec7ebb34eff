#include "slam/camera/lens_estimator.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "slam/camera/readout_estimate.h"
#include "slam/camera/undistort_map.h"
#include "slam/optimization/late_correction.h"
#include "slam/optimization/map_optimizer.h"

namespace waymark::slam {
namespace {

// None of the map's corners is beyond what the lens can see.
bool seesAllOf(const CameraModel& camera, const Map& map) {
  return std::ranges::all_of(map.keyframes(), [&](const auto& entry) {
    return std::ranges::all_of(entry.second.detections, [&](const MarkerDetection& detection) {
      return undistortCorners(camera, detection.pixels).has_value();
    });
  });
}

}  // namespace

bool LensEstimator::isDue(const Map& map) const {
  return options_.learn && static_cast<int>(map.keyframes().size()) >= next_keyframes_;
}

double LensEstimator::agreesChi2() const {
  return knowledge_->state == LensState::kGiven ? options_.agrees_chi2 : 0.0;
}

double LensEstimator::contradictsChi2() const {
  return knowledge_->state == LensState::kGiven ? options_.min_chi2
                                                : std::numeric_limits<double>::infinity();
}

LensProblem LensEstimator::problemOf(const RollingShutterEstimator& shutter) const {
  return {.in_use = *camera_,
          .expected = knowledge_->given,
          .prior = options_.prior,
          .readout_s = shutter.seconds(),
          .readout_known = shutter.isGiven(),
          .max_keyframes = options_.max_keyframes,
          .any_model = !options_.given,
          .any_beginning = knowledge_->state == LensState::kLearning,
          .agrees_chi2 = agreesChi2(),
          .contradicts_chi2 = contradictsChi2(),
          .since_ns = knowledge_->since_ns};
}

void LensEstimator::work(double cost, const RollingShutterEstimator& shutter, const Map& map,
                         const BundleOptions& optimization) {
  const bool idle = !dating_ && !estimate_ && !whole_;
  if (idle && isUndated()) {
    dating_of_ = knowledge_->earlier.size();
    dating_.emplace([&](Budget* budget) {
      return dateChange(map, changeOf(shutter), markers_, optimization, budget);
    });
  } else if (idle && isDue(map)) {
    next_keyframes_ =
        static_cast<int>(options_.growth * static_cast<double>(map.keyframes().size())) + 1;
    estimate_.emplace([&](Budget* budget) {
      return estimateLens(map, markers_, problemOf(shutter), optimization, budget);
    });
  }
  const double urgent = std::max(cost, options_.urgent_cost);
  if (dating_) (void)dating_->advance(urgent);
  if (estimate_) (void)estimate_->advance(isUrgent(map) || dated_anew_ ? urgent : cost);
  if (whole_) (void)whole_->advance(dated_anew_ ? urgent : cost);
}

std::optional<Transform> LensEstimator::collect(const RollingShutterEstimator& shutter,
                                                const BundleOptions& optimization, Map* map) {
  if (dating_ && dating_->done()) {
    const std::optional<std::int64_t> date = dating_->take();
    dating_.reset();
    // Another piece was faster, or the lens has changed once more meanwhile.
    if (!isUndated() || dating_of_ != knowledge_->earlier.size()) return std::nullopt;
    dated_with_ = knowledge_->changes;
    knowledge_->earlier.back().dated = knowledge_->state == LensState::kLearned;
    if (!date || *date == knowledge_->since_ns) return std::nullopt;
    noteDate(*date, shutter.seconds(), map);
    return Transform{};
  }
  if (estimate_ && estimate_->done()) {
    const std::optional<LensEstimate> found = estimate_->take();
    estimate_.reset();
    contradicted_ = found && lensChange(*found, *camera_) > options_.min_chi2;
    // What agrees is asked again when the map has grown twice as much.
    if (!found && agreesChi2() > 0.0) {
      next_keyframes_ = static_cast<int>(options_.growth * next_keyframes_);
    }
    if (!found || !believes(*found, *map)) {
      const bool is_old = found && found->correction.epoch != map->epoch();
      if (dated_anew_ && is_old) next_keyframes_ = static_cast<int>(map->keyframes().size());
      dated_anew_ = dated_anew_ && is_old;
      return std::nullopt;
    }
    contradicted_ = false;
    if (found->of_whole_map) return adopt(*found, shutter.seconds(), map);
    beginWhole(*found, shutter.seconds(), optimization, *map);
    return std::nullopt;
  }
  if (!isDone()) return std::nullopt;
  const MapCorrection correction = whole_->take();
  whole_.reset();
  const Coming coming = std::move(*coming_);
  coming_.reset();
  if (coming.epoch != map->epoch() || coming.readout_s != shutter.seconds()) {
    next_keyframes_ = static_cast<int>(map->keyframes().size());  // of a world that is no more
    return std::nullopt;
  }
  dated_anew_ = false;
  putInUse(coming.estimate);
  undistortAgain(*camera_, coming.readout_s, map, knowledge_->since_ns);
  const auto T_new_old = applyAllLate(correction, map);
  if (T_new_old) map->beginEpoch();
  return T_new_old;
}

void LensEstimator::beginWhole(const LensEstimate& estimate, double readout_s,
                               const BundleOptions& optimization, const Map& map) {
  coming_ = Coming{estimate, readout_s, map.epoch(), map};
  (void)seeThrough(estimate, readout_s, knowledge_->since_ns, &coming_->map);
  const Map& seen = coming_->map;
  whole_.emplace([&](Budget* budget) {
    return optimizeSubproblem(seen, wholeMap(seen), markers_, optimization, budget);
  });
}

bool LensEstimator::estimateNow(const RollingShutterEstimator& shutter,
                                const BundleOptions& optimization, Map* map) {
  if (!options_.learn || map->keyframes().empty()) return false;
  // Of several lenses it is the newest frames'. Both are known better by now.
  if (knowledge_->changedUnderWay()) {
    const auto date = runToCompletion([&](Budget* budget) {
      return dateChange(*map, changeOf(shutter), markers_, optimization, budget);
    });
    if (date && *date != knowledge_->since_ns) noteDate(*date, shutter.seconds(), map);
  }
  LensProblem problem = problemOf(shutter);
  if (goBackToGiven(problem, optimization, map)) return true;
  problem.max_keyframes = std::numeric_limits<int>::max();
  const auto found = runToCompletion(
      [&](Budget* budget) { return estimateLens(*map, markers_, problem, optimization, budget); });
  const bool believed = found && believes(*found, *map);
  if (believed) (void)adopt(*found, shutter.seconds(), map);
  if (!std::exchange(dated_anew_, false)) return believed;
  // What has bent must not be left out for that.
  (void)optimizeGlobally(map, markers_, ungated(optimization));
  return true;
}

LensChange LensEstimator::changeOf(const RollingShutterEstimator& shutter) const {
  const auto& earlier = knowledge_->earlier;
  LensChange change{.before = earlier.back().camera,
                    .after = *camera_,
                    .noticed_ns = knowledge_->since_ns,
                    .readout_s = shutter.seconds()};
  if (earlier.size() > 1) change.first_ns = earlier[earlier.size() - 2].until_ns;
  return change;
}

void LensEstimator::noteDate(std::int64_t since_ns, double readout_s, Map* map) {
  const std::int64_t first_ns = std::min(since_ns, knowledge_->since_ns);
  knowledge_->since_ns = knowledge_->earlier.back().until_ns = since_ns;
  undistortAgain(*camera_, *knowledge_, first_ns, readout_s, map);
  next_keyframes_ = static_cast<int>(map->keyframes().size());
  dated_anew_ = true;
}

// What a part of the map, or a map that was still bent, has said against a calibration holds only
// if the whole map says it, too.
bool LensEstimator::goBackToGiven(const LensProblem& problem, const BundleOptions& optimization,
                                  Map* map) {
  if (!options_.given || knowledge_->state == LensState::kGiven || knowledge_->refines_given ||
      knowledge_->changedUnderWay()) {
    return false;
  }
  const CameraModel given = knowledge_->given;
  if (!seesAllOf(given, *map)) return false;
  const auto compared = runToCompletion([&](Budget* budget) {
    return compareLens(given, *map, markers_, problem, optimization, budget);
  });
  if (!compared || compared->correction.keyframes.empty()) return false;
  if (compared->median_in_use_px < options_.material_rms * compared->median_px ||
      compared->evidence.chi2() > options_.min_chi2) {
    knowledge_->rms_given_px = compared->rms_px;
    knowledge_->rms_after_px = compared->rms_in_use_px;
    return false;
  }
  *camera_ = given;
  knowledge_->takeBack();
  (void)applyAround(compared->correction.keyframes.back().id, compared->correction, map);
  undistortAgain(given, problem.readout_s, map, knowledge_->since_ns);
  return true;
}

bool LensEstimator::believes(const LensEstimate& estimate, const Map& map) const {
  // Of coordinates that are not the map's any more; or of nothing.
  if (estimate.correction.epoch != map.epoch() || estimate.correction.keyframes.empty()) {
    return false;
  }
  const bool is_sound =
      coversImage(estimate.camera) >= coversImage(*camera_) && seesAllOf(estimate.camera, map);
  if (dated_anew_) return is_sound;
  const bool was_learned = knowledge_->state != LensState::kGiven;
  if (!was_learned && map.keyframes().size() < options_.views_against_given) return false;
  const double least = was_learned ? options_.min_change_chi2 : options_.min_chi2;
  const bool is_better_known =
      was_learned && estimate.focalShare() < options_.better_known * knowledge_->focalShare();
  if (!is_better_known && !(lensChange(estimate, *camera_) > least)) return false;
  // One more measurement of a lens that somebody has measured needs no reason beside that; to be
  // another one than was given it must make a difference.
  const bool refines = knowledge_->refines(estimate.camera, options_.prior);
  const bool material = estimate.rms_after_px < options_.material_rms * estimate.rms_before_px ||
                        estimate.evidence.chi2() > options_.min_chi2;
  if (!was_learned && !refines && !material) return false;
  return is_sound;
}

std::optional<Transform> LensEstimator::seeThrough(const LensEstimate& estimate, double readout_s,
                                                   std::int64_t since_ns, Map* map) {
  auto T_new_old = applyAllLate(estimate.correction, map);
  undistortAgain(estimate.camera, readout_s, map, since_ns);
  return T_new_old;
}

void LensEstimator::putInUse(const LensEstimate& estimate) {
  *camera_ = estimate.camera;
  knowledge_->adopt(estimate.camera, estimate.covariance, estimate.rms_before_px,
                    estimate.rms_after_px, options_.prior, options_.learned_focal_share);
}

std::optional<Transform> LensEstimator::adopt(const LensEstimate& estimate, double readout_s,
                                              Map* map) {
  putInUse(estimate);
  return seeThrough(estimate, readout_s, knowledge_->since_ns, map);
}

}  // namespace waymark::slam
