// Loops from frame to frame (seed 1, section 4.9): when a closure is begun, in slices, what it
// comes to, and what is made of frames that see both ends of a loop meanwhile.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/task.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/counters.h"
#include "slam/geometry/camera_model.h"
#include "slam/loop_closure/loop_closer.h"
#include "slam/marker_screening/marker_screening.h"
#include "slam/relocalization/relocalizer.h"
#include "slam/tracking/frame_tracker.h"
#include "slam/tracking/local_markers.h"

namespace waymark::slam {

// What is made of the markers of a frame that the neighbourhood does not know.
struct LoopJunction {
  // The frame joins both ends as they are: it is to become a keyframe, with `joined` in it.
  bool joins = false;
  std::vector<MarkerDetection> joined{};  // those of the markers that agree with its pose
};

// All that it is given at the start must outlive it, and the map a closure that is under way.
class LoopClosureManager {
 public:
  LoopClosureManager(const MarkerOptions& markers, const LoopOptions& options,
                     const RelocalizerOptions& relocalization, const CameraModel& camera,
                     const PoseOptimizer& optimizer, const LocalMarkers& local,
                     MarkerScreening* screening, Counters* counters)
      : markers_(markers),
        options_(options),
        relocalization_(relocalization),
        camera_(camera),
        optimizer_(optimizer),
        local_(local),
        screening_(screening),
        counters_(counters) {}

  // Markers in view that the neighbourhood does not know close a loop. Where both ends agree as
  // well as corners can tell, there is nothing to correct, and the next keyframe joins them; also
  // where they agree as well as the map agrees with itself (`residual_sigma`), and a correction was
  // rejected. Otherwise a closure is started. In a large map ends that differ by no more than it
  // may have drifted are joined, too, and what is around them is relaxed; markers that few
  // keyframes have seen are no witnesses there. fitting: the detections that agree with the pose.
  [[nodiscard]] LoopJunction closeOrJoin(const Map& map, double residual_sigma,
                                         const TrackedFrame& frame,
                                         std::span<const MarkerDetection> fitting);
  // Markers that have disagreed for long moved, or the map around them did: a loop that went
  // unnoticed, because the markers at its end were known here already. That is tried first. True
  // when it was the markers.
  [[nodiscard]] bool confirmMoved(const Map& map, const TrackedFrame& frame,
                                  std::span<const MarkerDetection> fitting);

  // idle: there is nothing else to do in this frame. A map that closures have seen to in part only
  // is optimized as a whole then; a closure that comes up meanwhile takes its place.
  void relaxInIdleTime(const Map& map, bool idle);
  // The map is not as good as it can be, though no closure has bent it.
  void noteBent() { bent_ = true; }
  // What tracking was lost for may be a loop's other end. A closure under way goes on.
  void notePlaceLost() {
    if (work_) work_->place_lost = true;
  }
  // A slice of the closure under way: `cost`, or more where it would be too late otherwise.
  void work(double cost);
  // Puts a closure that is done into the map. What that did to where the camera is, T_new_old;
  // empty when there is none, it was rejected, or came too late.
  std::optional<Transform> collect(Map* map);
  [[nodiscard]] bool isDone() const { return work_ && work_->task.done(); }
  [[nodiscard]] bool idle() const { return !work_; }
  // Of what the last closure needed: a large map's equations take a millisecond or two.
  void letGoOfSpent() { spent_.reset(); }

 private:
  enum class Cause {
    kOtherPlace,  // markers that the neighbourhood does not know
    kMisfits,     // markers of it that have long disagreed
    kBentMap,     // parts of the map were corrected, and the rest was not
  };
  // A loop that is being closed.
  struct Facts {
    Cause cause = Cause::kOtherPlace;
    int only_marker = -1;     // that closes it; -1 for several
    bool ends_agree = false;  // as well as the map agrees with itself
    bool regional = false;    // a part of the map is tried before all of it is
    double min_cost = 0.0;    // a frame, so that it is closed in time
  };
  struct Work {
    template <typename Begin>
    Work(const Facts& known, const Begin& begin) : facts(known), task(begin) {}

    Facts facts;
    bool place_lost = false;  // since it began
    SlicedTask<LoopOutcome> task;
  };

  // region: of a large map a part is to do.
  [[nodiscard]] bool start(const Map& map, std::span<const KnownMarker> markers,
                           const TrackedFrame& frame, std::span<const MarkerDetection> fitting,
                           Cause cause, bool ends_agree, bool region);
  // A closure is under way that is not to be disturbed.
  [[nodiscard]] bool isClosing() const { return work_ && work_->facts.cause != Cause::kBentMap; }
  // Too large for a closure to be done before what is not corrected has gone astray.
  [[nodiscard]] bool isLarge(const Map& map) const {
    return static_cast<int>(map.keyframes().size()) > options_.region_keyframes;
  }
  // The loop's markers: those that say where its other end is, and ids of those that few keyframes
  // have seen and that are not far off.
  struct Ends {
    std::vector<KnownMarker> witnesses;
    std::vector<int> young;
  };
  [[nodiscard]] Ends splitByViews(const Map& map, std::span<const KnownMarker> markers,
                                  const Transform& T_w_c) const;
  [[nodiscard]] double costToCloseInTime(const Map& map) const;
  [[nodiscard]] std::vector<int> fittingMarkers(std::span<const KnownMarker> markers,
                                                const Transform& T_w_c,
                                                double residual_sigma) const;
  [[nodiscard]] std::vector<int> explainedByDrift(const Map& map,
                                                  std::span<const KnownMarker> markers,
                                                  const Transform& T_w_c) const;
  [[nodiscard]] LoopJunction join(const std::vector<int>& agreeing, const std::vector<int>& young,
                                  const TrackedFrame& frame);
  void recordContradiction(const TrackedFrame& frame);
  void recordRejection(const Facts& facts, LoopRejection rejection);

  const MarkerOptions& markers_;
  const LoopOptions& options_;
  const RelocalizerOptions& relocalization_;
  const CameraModel& camera_;
  const PoseOptimizer& optimizer_;
  const LocalMarkers& local_;
  MarkerScreening* screening_;
  Counters* counters_;
  std::unique_ptr<Work> work_;
  std::unique_ptr<Work> spent_;     // done; let go of in a frame that has the time
  bool whole_map_next_ = false;     // a part of it was not enough
  bool bent_ = false;               // only parts of the map were corrected
  int idle_frames_ = 0;             // in a row
  bool misfits_rejected_ = false;   // the last loop to misfits
  int frames_to_next_attempt_ = 0;  // to close a loop, after one was rejected
  int contradicting_marker_ = -1;   // the only marker of that loop; -1 for none
};

}  // namespace waymark::slam
