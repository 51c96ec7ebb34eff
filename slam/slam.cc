#include "slam/slam.h"

#include <utility>
#include <vector>

#include "base/task.h"
#include "slam/batch_mapper.h"
#include "slam/camera/rolling_shutter_estimator.h"
#include "slam/covariance/map_covariance.h"
#include "slam/feature_stage.h"
#include "slam/frame_detector.h"
#include "slam/geometry/twist.h"
#include "slam/map/world_reference.h"
#include "slam/map_start.h"
#include "slam/mapping/map_updater.h"
#include "slam/marker_screening/marker_screening.h"
#include "slam/picture_stage.h"
#include "slam/tracking/frame_tracker.h"
#include "slam/tracking/local_markers.h"

namespace waymark::slam {

class Slam::Impl {
 public:
  Impl(const CameraModel& camera, Dictionary dictionary, const Options& options, Map map)
      : options_(withSurveyedPictures(options)),
        camera_(camera),
        detector_(camera_, std::move(dictionary), options_.detector, options_.follower, &counters_),
        screening_(options.markers, options.screening),
        rolling_shutter_(options.shutter, options.markers),
        tracker_(camera_, options.tracking, rolling_shutter_),
        updater_(
            {options_.markers, options_.mapper, options_.loops, options_.tracking.relocalization},
            camera_, tracker_.tracker().optimizer(), local_, &screening_, &rolling_shutter_,
            &counters_),
        map_(std::move(map)),
        covariance_(options_.markers, options_.covariance, map_, options_.mapping),
        features_(options_.natural, camera_, covariance_, &counters_),
        pictures_({options_, &updater_, &covariance_, &features_, &map_, &counters_}),
        world_(options_.markers),
        start_({options_, camera_, tracker_.tracker(), &updater_, &covariance_, &map_}),
        batch_({options_, screening_, rolling_shutter_, tracker_.tracker(), &camera_, &updater_,
                &covariance_, &map_}) {
    map_.dictionary = detector_.dictionary().name();
  }

  // The stages of seed 1, Fig. 4, in its order.
  FrameResult process(const FrameInput& frame, StageObserver* observer) {
    ++counters_.frames;
    FrameResult result;
    auto prediction = tracker_.predict(frame.time.monotonic_ns);
    result.detections = detector_.detect(frame, map_, local_, prediction, observer);
    if (pictures_.hear(frame.late, observer)) result.map_changed = true;
    if (updater_.hasFinishedWork()) {
      const StageScope scope(observer, Stage::kMap);
      collectWork(&result);
      prediction = tracker_.predict(frame.time.monotonic_ns);  // in the map's new coordinates
    }
    const auto usable = screening_.screen(result.detections, camera_, map_, &counters_);
    std::optional<TrackedFrame> tracked;
    if (map_.empty()) {
      initialize(usable, frame, observer, &result);
    } else {
      tracked = track(usable, frame, prediction, observer, &result);
      if (!tracked) bridge(usable, frame, observer, &result);
      if (options_.mapping) {
        const StageScope scope(observer, Stage::kMap);
        if (tracked) grow(*tracked, &result);
        // Also after a new keyframe: in fast motion every frame is one.
        updater_.work(options_.work_per_frame, map_);
      }
      followMap(observer, &result);
    }
    const auto fitting = tracked ? tracked->fitting : std::span<const MarkerDetection>();
    pictures_.await(frame, result, fitting, observer);
    if (result.pose) ++counters_.localized;
    if (options_.mapping && world_.isMissing(map_)) ++counters_.frames_in_other_world;
    return result;
  }

  // What is under way is done first.
  [[nodiscard]] BatchMapper& batch() {
    while (options_.mapping && !updater_.idle(map_)) {
      updater_.work(kUnlimited, map_);
      FrameResult nobodys;
      collectWork(&nobodys);
    }
    return batch_;
  }
  [[nodiscard]] const BatchMapper& batch() const { return batch_; }

  [[nodiscard]] const Map& map() const { return map_; }
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const CameraModel& camera() const { return camera_; }
  [[nodiscard]] double readout_s() const { return rolling_shutter_.seconds(); }

 private:
  // What was under way and is done goes into the map before the next frame is tracked in it.
  void collectWork(FrameResult* result) {
    const FinishedWork finished = updater_.collect(&map_);
    for (const Transform& T_new_old : finished.T_new_old) {
      tracker_.correct(T_new_old);
      features_.moveWorld(T_new_old);
      pictures_.moveWorld(T_new_old);
    }
    if (!finished.T_new_old.empty()) result->map_changed = true;
    result->keyframe_added = finished.loop_closed;
    if (finished.loop_closed) local_.reset();
  }

  // Section 4.1.
  void initialize(std::span<const MarkerDetection> usable, const FrameInput& frame,
                  StageObserver* observer, FrameResult* result) {
    {
      const StageScope scope(observer, Stage::kMap);
      result->state = TrackingState::kInitializing;
      result->reason = options_.mapping ? start_.process(usable, frame.time) : NoPoseReason::kNoMap;
      result->map_changed = result->keyframe_added = result->reason == NoPoseReason::kNone;
      result->pose = start_.pose();
    }
    if (result->pose) {
      result->state = TrackingState::kTracking;
      tracker_.commit(*result->pose, frame.time.monotonic_ns);
    } else if (pictures_.any()) {
      (void)features_.bridge(frame, observer);  // from a frame that pictures may be found in
    }
  }

  // Sections 4.3 and 4.8. Empty where the markers give no pose that is believed.
  std::optional<TrackedFrame> track(std::span<const MarkerDetection> usable,
                                    const FrameInput& frame,
                                    const std::optional<Prediction>& prediction,
                                    StageObserver* observer, FrameResult* result) {
    auto tracked = trackMarkers(usable, frame.time, prediction, observer, result);
    if (!tracked) return std::nullopt;
    PoseEstimate pose = tracker_.estimateOf(*tracked);
    if (!features_.follow(frame, *tracked, pose, observer)) {
      result->reason = NoPoseReason::kMarkersDoNotFit;
      return std::nullopt;
    }
    const StageScope scope(observer, Stage::kTrack);
    pose.covariance =
        covariance_.follow(tracked->solution, tracked->eligible) + coverOfOtherPose(*tracked);
    if (const auto fused = features_.fused()) pose = *fused;
    result->pose = pose;
    result->state = TrackingState::kTracking;
    tracker_.commit(pose, frame.time.monotonic_ns);
    return tracked;
  }

  std::optional<TrackedFrame> trackMarkers(std::span<const MarkerDetection> usable,
                                           const FrameTime& time,
                                           const std::optional<Prediction>& prediction,
                                           StageObserver* observer, FrameResult* result) {
    const StageScope scope(observer, Stage::kTrack);
    const FrameMarkers markers = tracker_.split(map_, usable, time, prediction, local_);
    TrackingOutcome outcome = tracker_.track(map_, markers, prediction);
    counters_.rejected_poses += static_cast<std::uint64_t>(outcome.rejected_poses);
    if (outcome.lost_place) {  // what comes now may be at a loop's other end
      local_.reset();
      updater_.cancelLoopClosure();
    }
    result->reason = outcome.reason;
    result->state = TrackingState::kRelocalizing;
    if (!outcome.frame) return std::nullopt;
    if (outcome.frame->method == TrackingMethod::kRelocalized) ++counters_.relocalizations;
    const FittedMarkers fitted =
        tracker_.fit(map_, markers, *outcome.frame, updater_.residualSigma());
    counters_.rejected_markers += static_cast<std::uint64_t>(fitted.rejected);
    for (const auto& [marker, agrees] : fitted.verdicts) {
      screening_.record(marker, agrees, time.monotonic_ns);
    }
    outcome.frame->fitting = fitted.fitting;
    return std::move(outcome.frame);
  }

  // Between the markers.
  void bridge(std::span<const MarkerDetection> usable, const FrameInput& frame,
              StageObserver* observer, FrameResult* result) {
    result->pose = features_.bridge(frame, observer);
    if (!result->pose) return;
    result->state = TrackingState::kBridging;
    result->reason = NoPoseReason::kNone;
    tracker_.commit(*result->pose, frame.time.monotonic_ns);
    if (options_.mapping && result->pose->source == PoseSource::kNaturalFeatures) {
      growThroughGap(usable, frame.time, observer, result);
    }
  }

  void growThroughGap(std::span<const MarkerDetection> usable, const FrameTime& time,
                      StageObserver* observer, FrameResult* result) {
    const StageScope scope(observer, Stage::kMap);
    const PoseEstimate& pose = *result->pose;
    const auto joined = updater_.growThroughGap(
        {time, usable, pose.T_w_c, pose.view_covariance, pose.twist, features_.anchor()}, &map_);
    if (!joined) return;
    covariance_.introduce(*joined, pose.T_w_c, pose.covariance, &map_);
    result->map_changed = result->keyframe_added = true;
  }

  // The map's uncertainty follows its changes, in slices.
  void followMap(StageObserver* observer, FrameResult* result) {
    const StageScope scope(observer, Stage::kMap);
    if (result->map_changed || result->keyframe_added) covariance_.noteChange();
    if (covariance_.work(updater_.residualSigma(), &map_)) result->map_changed = true;
  }

  // Sections 4.2 and 4.4 to 4.9.
  void grow(const TrackedFrame& frame, FrameResult* result) {
    const MapGrowth growth = updater_.grow(frame, &map_);
    result->map_changed = result->map_changed || growth.map_changed;
    result->keyframe_added = result->keyframe_added || growth.keyframe_added;
    const Transform& T_w_c = result->pose->T_w_c;
    const auto depth_m = medianDepth(map_, growth.fitting, T_w_c);
    local_.update(map_, growth.fitting, T_w_c, depth_m, options_.mapper.keyframes);
  }

  Options options_;
  CameraModel camera_;
  Counters counters_;
  FrameDetector detector_;
  MarkerScreening screening_;
  RollingShutterEstimator rolling_shutter_;
  LocalMarkers local_;
  FrameTracker tracker_;
  MapUpdater updater_;
  Map map_;
  MapCovariance covariance_;
  FeatureStage features_;
  PictureStage pictures_;
  WorldReference world_;
  MapStart start_;
  BatchMapper batch_;
};

Slam::Slam(const CameraModel& camera, Dictionary dictionary, const Options& options, Map map)
    : impl_(std::make_unique<Impl>(camera, std::move(dictionary), options, std::move(map))) {}
Slam::~Slam() = default;

FrameResult Slam::process(const FrameInput& frame, StageObserver* observer) {
  return impl_->process(frame, observer);
}

const Map& Slam::map() const { return impl_->map(); }
const Counters& Slam::counters() const { return impl_->counters(); }
const CameraModel& Slam::camera() const { return impl_->camera(); }
void Slam::densify(std::span<const RecordedFrame> frames) { impl_->batch().densify(frames); }
void Slam::finish() { impl_->batch().recoverCovariance(); }
void Slam::optimizeGlobally() { impl_->batch().optimize(); }
void Slam::optimizeGloballyWithIntrinsics() { impl_->batch().optimizeWithIntrinsics(); }

std::optional<PoseEstimate> Slam::localize(const RecordedFrame& frame) const {
  return std::as_const(*impl_).batch().localize(frame);
}

std::optional<PosesOfOneMarker> Slam::localizeByOneMarker(const RecordedFrame& frame) const {
  return std::as_const(*impl_).batch().localizeByOneMarker(frame);
}

double Slam::readout_s() const { return impl_->readout_s(); }

}  // namespace waymark::slam
