// What a tracked frame does to the map (seed 1, sections 4.2 and 4.4 to 4.9): loops, keyframes,
// untrustworthy markers; and what goes on over many frames, in slices: local optimization, loop
// closure, the lens, the rolling shutter's readout time.
#pragma once

#include <span>
#include <vector>

#include "slam/camera/lens_estimator.h"
#include "slam/camera/rolling_shutter_estimator.h"
#include "slam/counters.h"
#include "slam/loop_closure/loop_closure_manager.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/mapping/gap_mapper.h"
#include "slam/mapping/mapper.h"
#include "slam/marker_screening/marker_screening.h"
#include "slam/tracking/frame_tracker.h"

namespace waymark::slam {

// What a frame has changed in the map.
struct MapGrowth {
  bool map_changed = false;
  bool keyframe_added = false;
  // The detections that fit, with those of a loop's other end, without those banned or quarantined.
  // Valid until the next frame.
  std::span<const MarkerDetection> fitting;
};

// What finished work has changed in the map.
struct FinishedWork {
  // How the map moved under the camera, one correction after the other; empty: not at all.
  std::vector<Transform> T_new_old;
  bool loop_closed = false;
  bool lens_changed = false;
};

// The options of what it puts together.
struct MapUpdaterOptions {
  const MarkerOptions& markers;
  const MapperOptions& mapper;
  const LoopOptions& loops;
  const RelocalizerOptions& relocalization;
};

// All that it is given must outlive it.
class MapUpdater {
 public:
  MapUpdater(const MapUpdaterOptions& options, const CameraModel& camera,
             const PoseOptimizer& optimizer, const LocalMarkers& local, MarkerScreening* screening,
             RollingShutterEstimator* rolling_shutter, LensEstimator* lens, Counters* counters)
      : options_(options),
        camera_(camera),
        screening_(screening),
        rolling_shutter_(rolling_shutter),
        lens_(lens),
        counters_(counters),
        mapper_(options.markers, camera.focalLength(), options.mapper),
        gaps_(options.markers, camera.focalLength(), options.mapper.marker_pose,
              options.mapper.gaps),
        pictures_(options.mapper.pictures),
        loops_(options.markers, options.loops, options.relocalization, camera, optimizer, local,
               screening, counters) {}

  // The first keyframes and markers of an empty map. Returns where the last of them is.
  Transform begin(const Start& start, Map* map);
  [[nodiscard]] MapGrowth grow(const TrackedFrame& frame, Map* map);
  // From a frame without a pose from markers, whose detections are as they were seen. The marker
  // that joined the map, if one did.
  [[nodiscard]] std::optional<int> growThroughGap(CarriedFrame frame, Map* map);
  // Before grow(), of a frame that a bridge ends with. carried: where features alone have it, as
  // seen from the anchor; its detections are the frame's. False where that changes nothing.
  [[nodiscard]] bool growAtArrival(const TrackedFrame& frame, CarriedFrame carried, Map* map);
  // Before grow(). carried: where features that were followed through the last gap have the camera,
  // if they still are; its detections are the frame's. False where that changes nothing.
  [[nodiscard]] bool growAfterGap(const TrackedFrame& frame, std::optional<CarriedFrame> carried,
                                  Map* map);
  // A picture seen from an earlier frame. False where that changes nothing. Precondition: it is
  // among the map's markers.
  [[nodiscard]] bool growByPicture(const AwaitedFrame& frame, const LateResult& seen, Map* map);
  // Another piece of the map has come in, and hangs on few keyframes: the one to optimize around
  // first; all of the map follows in idle time.
  void noteJoint(KeyframeId keyframe) {
    mapper_.want(keyframe);
    loops_.noteBent();
  }

  // The camera may be elsewhere than it was tracked so far.
  void notePlaceLost() { loops_.notePlaceLost(); }

  // A slice of what is under way, of a cost of at most `budget`.
  void work(double budget, const Map& map);
  [[nodiscard]] bool hasFinishedWork() const {
    return mapper_.worldMoved() || mapper_.isDone() || lens_->isDone() || loops_.isDone() ||
           (asksShutter() && rolling_shutter_->isDone());
  }
  [[nodiscard]] bool loopsIdle() const { return loops_.idle(); }
  // Puts into the map what is done.
  [[nodiscard]] FinishedWork collect(Map* map);
  // Nothing is under way, due, or waits to be collected.
  [[nodiscard]] bool idle(const Map& map) const {
    return mapper_.idle() && shutterIdle(map) && lens_->idle(map) && loops_.idle();
  }

  // Standard deviation of the map's whitened residuals as of late, at least 1.
  [[nodiscard]] double residualSigma() const { return mapper_.residualSigma(); }
  // Section 4.5 for all markers without a pose.
  void resolveAll(Map* map) { mapper_.resolveAll(map); }

 private:
  // Of several lenses the shutter is not asked any more: which corners it would move is unclear.
  [[nodiscard]] bool asksShutter() const { return !lens_->changedUnderWay(); }
  [[nodiscard]] bool shutterIdle(const Map& map) const {
    return !asksShutter() || rolling_shutter_->idle(map);
  }
  bool tellKeyframesTheirMotion(const TrackedFrame& frame, Map* map);
  [[nodiscard]] bool screenMarkers(const TrackedFrame& frame, Map* map);

  MapUpdaterOptions options_;
  const CameraModel& camera_;
  MarkerScreening* screening_;
  RollingShutterEstimator* rolling_shutter_;
  LensEstimator* lens_;
  KeyframeId first_fresh_ = 0;  // from here on keyframes do not know yet how they went on moving
  Counters* counters_;
  Mapper mapper_;
  GapMapper gaps_;
  PictureMapper pictures_;
  LoopClosureManager loops_;
  std::vector<MarkerDetection> fitting_;  // reused from frame to frame
  std::vector<MarkerDetection> carried_;  // likewise
};

}  // namespace waymark::slam
