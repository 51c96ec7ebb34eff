// Loops from frame to frame (seed 1, section 4.9): when a closure is begun, in slices, what it
// comes to, and what is made of frames that see both ends of a loop meanwhile.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "base/task.h"
#include "slam/counters.h"
#include "slam/geometry/camera_model.h"
#include "slam/loop_closure/loop_closer.h"
#include "slam/loop_closure/loop_detector.h"
#include "slam/marker_screening/marker_screening.h"
#include "slam/options.h"
#include "slam/tracking/frame_context.h"
#include "slam/tracking/pose_optimizer.h"

namespace waymark::slam {

// All that it is given at the start must outlive it, and the map a closure that is under way.
class LoopClosureManager {
 public:
  LoopClosureManager(const Options& options, const CameraModel& camera,
                     const PoseOptimizer& optimizer, const LoopDetector& detector,
                     MarkerScreening* screening, Counters* counters)
      : options_(options),
        camera_(camera),
        optimizer_(optimizer),
        detector_(detector),
        screening_(screening),
        counters_(counters) {}

  // Markers in view that the neighbourhood does not know close a loop. Where both ends agree as
  // well as corners can tell, there is nothing to correct, and the next keyframe joins them; also
  // where they agree as well as the map agrees with itself (`noise`), and a correction was
  // rejected.
  void meet(const Map& map, double residual_sigma, FrameContext* context);
  // Markers that have disagreed for long moved, or the map around them did: a loop that went
  // unnoticed, because the markers at its end were known here already. That is tried first. True
  // when they moved.
  [[nodiscard]] bool haveMoved(const Map& map, const FrameContext& context);

  // A slice of the closure under way: `units`, or more where it would be too late otherwise.
  void work(double cost);
  // Puts a closure that is done into the map. What that did to where the camera is, T_new_old;
  // empty when there is none, it was rejected, or came too late.
  std::optional<Transform> collect(Map* map);
  [[nodiscard]] bool isDone() const { return work_ && work_->task.done(); }
  [[nodiscard]] bool idle() const { return !work_; }
  // What is under way is of no use any more: tracking was lost.
  void forget() { work_.reset(); }

 private:
  enum class Cause {
    kOtherPlace,  // markers that the neighbourhood does not know
    kMisfits,     // markers of it that have long disagreed
  };
  // A loop that is being closed.
  struct Facts {
    Cause cause = Cause::kOtherPlace;
    int only_marker = -1;     // that closes it; -1 for several
    bool ends_agree = false;  // as well as the map agrees with itself
    double min_cost = 0.0;    // a frame, so that it is closed in time
  };
  struct Work {
    template <typename Begin>
    Work(const Facts& known, const Begin& begin) : facts(known), task(begin) {}

    Facts facts;
    SlicedTask<LoopOutcome> task;
  };

  [[nodiscard]] bool begin(const Map& map, std::span<const KnownMarker> markers,
                           const FrameContext& context, Cause cause, bool ends_agree);
  [[nodiscard]] double costToCloseInTime(const Map& map) const;
  [[nodiscard]] std::vector<int> fittingMarkers(std::span<const KnownMarker> markers,
                                                const Transform& T_w_c,
                                                double residual_sigma) const;
  void join(const std::vector<int>& agreeing, FrameContext* context);
  void recordContradiction(const FrameContext& context);
  void recordRejection(const Facts& facts, LoopRejection rejection);

  const Options& options_;
  const CameraModel& camera_;
  const PoseOptimizer& optimizer_;
  const LoopDetector& detector_;
  MarkerScreening* screening_;
  Counters* counters_;
  std::optional<Work> work_;
  bool misfits_rejected_ = false;   // the last loop to misfits
  int frames_to_next_attempt_ = 0;  // to close a loop, after one was rejected
  int contradicting_marker_ = -1;   // the only marker of that loop; -1 for none
};

}  // namespace waymark::slam
