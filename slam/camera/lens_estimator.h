// The lens in use, as given or learned along with the map. Beyond seed 1, which optimizes the
// intrinsics at the end only (Eq. 41): a lens that is 1 % off bends the map while it grows.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "base/task.h"
#include "slam/camera/lens_change.h"
#include "slam/camera/lens_estimate.h"
#include "slam/camera/lens_knowledge.h"
#include "slam/camera/lens_options.h"
#include "slam/camera/rolling_shutter_estimator.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam {

class LensEstimator {
 public:
  // camera: the lens in use, that undistorted the map's corners. All must outlive it.
  LensEstimator(const LensOptions& options, const MarkerOptions& markers, CameraModel* camera,
                LensKnowledge* knowledge)
      : options_(options),
        markers_(markers),
        camera_(camera),
        knowledge_(knowledge),
        next_keyframes_(options.first_keyframes) {}

  // A slice of what is under way: when the lens changed, if it did; an estimate, begun when the map
  // has grown enough since the last one; or, where that was believed and was of a part of the map,
  // an optimization of all of it, in a copy: until that is done, lens and map stay as they are,
  // which belong together.
  void work(double cost, const RollingShutterEstimator& shutter, const Map& map,
            const BundleOptions& optimization);
  // Puts what is done into the map. A lens that is believed is in use from here on, and all
  // keyframes' corners and poses follow. What that did to the newest keyframe taken part:
  // T_new_old; empty when nothing has changed.
  std::optional<Transform> collect(const RollingShutterEstimator& shutter,
                                   const BundleOptions& optimization, Map* map);
  [[nodiscard]] bool isDone() const {
    return (dating_ && dating_->done()) || (estimate_ && estimate_->done()) ||
           (whole_ && whole_->done());
  }
  // The lens has not been one and the same for all of the map.
  [[nodiscard]] bool changedUnderWay() const { return knowledge_->changedUnderWay(); }
  // The beginning of a map contradicts the lens in use, or another one was learned that is not
  // known well yet: what does not fit may be the lens.
  [[nodiscard]] bool inDoubt(const Map& map) const {
    return (contradicted_ && isUrgent(map)) || knowledge_->state == LensState::kLearning || coming_;
  }
  // Nothing is under way or due.
  [[nodiscard]] bool idle(const Map& map) const {
    return !dating_ && !estimate_ && !whole_ && !isUndated() && !isDue(map);
  }
  // At once, from all of the map, whatever it costs. Whether another lens is in use now.
  bool estimateNow(const RollingShutterEstimator& shutter, const BundleOptions& optimization,
                   Map* map);

 private:
  [[nodiscard]] bool isDue(const Map& map) const;
  [[nodiscard]] bool isUrgent(const Map& map) const {
    return static_cast<int>(map.keyframes().size()) < options_.urgent_keyframes;
  }
  // LensProblem's: a lens that was learned is always estimated to the end.
  [[nodiscard]] double agreesChi2() const;
  // The same; none is held against a lens that was learned, which gives way without a reason.
  [[nodiscard]] double contradictsChi2() const;
  [[nodiscard]] LensProblem problemOf(const RollingShutterEstimator& shutter) const;
  [[nodiscard]] bool believes(const LensEstimate& estimate, const Map& map) const;
  [[nodiscard]] LensChange changeOf(const RollingShutterEstimator& shutter) const;
  // The lens has changed, and from what was seen just before it is not yet known through which lens
  // that was.
  [[nodiscard]] bool isUndated() const {
    return options_.learn && knowledge_->changedUnderWay() && !knowledge_->earlier.back().dated &&
           knowledge_->changes != dated_with_;
  }
  // The newest lens was in use since then: the map's keyframes are undistorted as seen through the
  // lens of their time.
  void noteDate(std::int64_t since_ns, double readout_s, Map* map);
  [[nodiscard]] bool goBackToGiven(const LensProblem& problem, const BundleOptions& optimization,
                                   Map* map);
  // Poses and corners of the map are as the estimate says.
  static std::optional<Transform> seeThrough(const LensEstimate& estimate, double readout_s,
                                             std::int64_t since_ns, Map* map);
  void putInUse(const LensEstimate& estimate);
  std::optional<Transform> adopt(const LensEstimate& estimate, double readout_s, Map* map);
  void beginWhole(const LensEstimate& estimate, double readout_s, const BundleOptions& optimization,
                  const Map& map);

  LensOptions options_;
  MarkerOptions markers_;
  CameraModel* camera_;
  LensKnowledge* knowledge_;
  bool contradicted_ = false;  // by the last estimate
  int next_keyframes_;         // it is estimated again when the map has so many
  std::optional<SlicedTask<std::optional<std::int64_t>>> dating_;
  std::size_t dating_of_ = 0;  // which change: there were so many lenses before it
  int dated_with_ = -1;        // the lens of so many changes; a better one asks again
  bool dated_anew_ = false;    // and not yet estimated since
  std::optional<SlicedTask<std::optional<LensEstimate>>> estimate_;
  // A lens that is believed, of a part of the map; and all of the map as seen through it.
  struct Coming {
    LensEstimate estimate;
    double readout_s = 0.0;
    std::uint64_t epoch = 0;  // of the map that it was estimated from
    Map map;
  };
  std::optional<Coming> coming_;  // outlives whole_, which reads it
  std::optional<SlicedTask<MapCorrection>> whole_;
};

}  // namespace waymark::slam
