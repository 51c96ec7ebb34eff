#include "slam/slam.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/task.h"
#include "slam/camera/rolling_shutter_estimator.h"
#include "slam/covariance/map_covariance.h"
#include "slam/detection/search/marker_follower.h"
#include "slam/geometry/twist.h"
#include "slam/initialization/initializer.h"
#include "slam/mapping/map_updater.h"
#include "slam/marker_screening/marker_screening.h"
#include "slam/natural/pose_integrator.h"
#include "slam/optimization/map_optimizer.h"
#include "slam/tracking/expected_markers.h"
#include "slam/tracking/frame_tracker.h"
#include "slam/tracking/local_markers.h"

namespace waymark::slam {

class Slam::Impl {
 public:
  Impl(const CameraModel& camera, Dictionary dictionary, const Options& options, Map map)
      : options_(options),
        camera_(camera),
        given_intrinsics_(camera.intrinsics()),
        follower_(camera_, std::move(dictionary), options.detector, options.follower),
        screening_(options.markers, options.screening),
        initializer_(options.markers, camera_.focalLength(), options.initialization),
        rolling_shutter_(options.shutter, options.markers),
        tracker_(camera_, options.tracking, rolling_shutter_),
        updater_(
            {options_.markers, options_.mapper, options_.loops, options_.tracking.relocalization},
            camera_, tracker_.tracker().optimizer(), local_, &screening_, &rolling_shutter_,
            &counters_),
        locator_(screening_, camera_, rolling_shutter_, tracker_.tracker()),
        map_(std::move(map)),
        covariance_(options_.markers, options_.covariance, map_, options_.mapping),
        integrator_(options_.natural, camera_, &counters_),
        last_old_keyframe_(map_.keyframes().empty() ? -1 : map_.keyframes().rbegin()->first) {
    map_.dictionary = follower_.dictionary().name();
  }

  // The stages of seed 1, Fig. 4, in its order.
  FrameResult process(const FrameInput& frame, StageObserver* observer) {
    ++counters_.frames;
    FrameResult result;
    auto prediction = tracker_.predict(frame.time.monotonic_ns);
    result.detections = detect(frame, prediction, observer);
    if (updater_.hasFinishedWork()) {
      const StageScope scope(observer, Stage::kMap);
      collectWork(&result);
      prediction = tracker_.predict(frame.time.monotonic_ns);  // in the map's new coordinates
    }
    const auto usable = screening_.screen(result.detections, camera_, map_, &counters_);
    if (map_.empty()) {
      const StageScope scope(observer, Stage::kMap);
      initialize(usable, frame.time, &result);
    } else {
      const auto tracked = track(usable, frame, prediction, observer, &result);
      if (!tracked) bridge(frame, observer, &result);
      if (options_.mapping) {
        const StageScope scope(observer, Stage::kMap);
        if (tracked) grow(*tracked, &result);
        // Also after a new keyframe: in fast motion every frame is one.
        updater_.work(options_.work_per_frame, map_);
      }
      followMap(observer, &result);
    }
    if (result.pose) ++counters_.localized;
    if (isInOtherWorld()) ++counters_.frames_in_other_world;
    return result;
  }

  void finish() {
    finishWork();
    covariance_.recover(updater_.residualSigma(), &map_);
  }

  void densify(std::span<const RecordedFrame> frames) {
    finishWork();
    if (!options_.mapping) return;
    locator_.densify(frames, last_old_keyframe_, &map_);
    updater_.resolveAll(&map_);
  }

  void optimizeMapGlobally() {
    finishWork();
    if (options_.mapping && !map_.keyframes().empty()) {
      const BundleSummary summary =
          slam::optimizeGlobally(&map_, options_.markers, options_.global_optimization);
      covariance_.recover(summary.residual_sigma, &map_);
    }
  }

  void optimizeMapAndLens() {
    finishWork();
    if (!options_.mapping || map_.keyframes().empty()) return;
    (void)slam::optimizeGloballyWithIntrinsics(&map_, options_.markers, given_intrinsics_,
                                               options_.intrinsics, rolling_shutter_.seconds(),
                                               options_.global_optimization, &camera_);
    covariance_.recover(updater_.residualSigma(), &map_);
  }

  [[nodiscard]] std::optional<PoseEstimate> localize(const RecordedFrame& frame) const {
    auto located = locator_.locate(map_, frame);
    if (!located) return std::nullopt;
    located->solution.widenTo(updater_.residualSigma() * updater_.residualSigma());
    auto estimate = tracker_.tracker().estimateOf(located->solution, located->known, frame.twist);
    estimate.covariance = covariance_.inWorld(located->solution, located->known);
    return estimate;
  }

  [[nodiscard]] std::optional<PosesOfOneMarker> localizeByOneMarker(
      const RecordedFrame& frame) const {
    auto located = locator_.locateByOneMarker(map_, frame, options_.tracking.relocalization.square);
    if (!located) return std::nullopt;
    PosesOfOneMarker both{
        located->known.front().detection->id, {}, located->view.log_odds, located->view.barrier};
    for (std::size_t i = 0; i < 2; ++i) {
      PoseSolution& solution = located->solutions[i];
      solution.widenTo(updater_.residualSigma() * updater_.residualSigma());
      both.poses[i] = tracker_.tracker().estimateOf(solution, located->known, frame.twist);
      both.poses[i].covariance = covariance_.inWorld(solution, located->known);
    }
    return both;
  }

  [[nodiscard]] const Map& map() const { return map_; }
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const CameraModel& camera() const { return camera_; }
  [[nodiscard]] double readout_s() const { return rolling_shutter_.seconds(); }

 private:
  void finishWork() {
    while (options_.mapping && !updater_.idle(map_)) {
      updater_.work(kUnlimited, map_);
      FrameResult nobodys;
      collectWork(&nobodys);
    }
  }

  // The corners in the image, looked for where the map's markers are expected first.
  std::span<const MarkerDetection> detect(const FrameInput& frame,
                                          const std::optional<Prediction>& prediction,
                                          StageObserver* observer) {
    if (frame.detections || !frame.image) {
      return frame.detections.value_or(std::span<const MarkerDetection>{});
    }
    const StageScope scope(observer, Stage::kDetect);
    const auto expected = expectation_.update(map_, prediction, local_, follower_.followed());
    const auto& found = follower_.find(*frame.image, frame.time.monotonic_ns, expected, observer);
    countSearch();
    return found;
  }

  void countSearch() {
    switch (follower_.mode()) {
      case SearchMode::kFullScan:
        ++counters_.full_scans;
        break;
      case SearchMode::kFollowing:
        ++counters_.followed_frames;
        break;
      case SearchMode::kInTurns:
        ++counters_.busy_frames;
        break;
    }
    counters_.deferred_candidates = follower_.work().deferred;
    const DetectorCounters& detector = follower_.counters();
    counters_.quads = detector.quads;
    counters_.merged_quads = detector.merged;
    counters_.rejected_quads = detector.rejected;
    counters_.quads_without_edges = detector.no_edge;
    counters_.quads_without_code = detector.no_code;
  }

  // Whether the marker that is to be the world's origin, or every anchor, has no place in the map
  // yet. A map that is not to grow keeps the world it was made with.
  [[nodiscard]] bool isInOtherWorld() {
    if (world_is_fixed_ || !options_.mapping) return false;
    const MarkerOptions& markers = options_.markers;
    const auto is_missing = [&](int id) { return map_.findPosed(id) == nullptr; };
    const bool missing = markers.origin_marker
                             ? is_missing(*markers.origin_marker)
                             : !markers.anchors.empty() &&
                                   std::ranges::all_of(markers.anchors, is_missing, &Anchor::id);
    world_is_fixed_ = !missing;
    return missing;
  }

  // What was under way and is done goes into the map before the next frame is tracked in it.
  void collectWork(FrameResult* result) {
    const FinishedWork finished = updater_.collect(&map_);
    for (const Transform& T_new_old : finished.T_new_old) {
      tracker_.correct(T_new_old);
      integrator_.moveWorld(T_new_old);
    }
    result->map_changed = !finished.T_new_old.empty();
    result->keyframe_added = finished.loop_closed;
    if (finished.loop_closed) local_.reset();
  }

  // Section 4.1.
  void initialize(std::span<const MarkerDetection> usable, const FrameTime& time,
                  FrameResult* result) {
    result->state = TrackingState::kInitializing;
    if (!options_.mapping) {
      result->reason = NoPoseReason::kNoMap;
      return;
    }
    const auto start = initializer_.process(
        {-1, time.sequence, time.monotonic_ns, Transform{}, {usable.begin(), usable.end()}});
    if (!start) {
      result->reason = initializer_.reason();
      return;
    }
    const Transform T_w_c = updater_.begin(*start, &map_);
    result->map_changed = result->keyframe_added = true;
    const std::vector<KnownMarker> known = knownMarkers(map_, usable);
    const auto solution = tracker_.tracker().optimizer().optimize(known, T_w_c);
    if (!solution) return;
    result->pose = tracker_.tracker().estimateOf(*solution, known, Twist::Zero());
    result->pose->T_w_c = T_w_c;  // of a keyframe: by definition of the world, or as optimized
    covariance_.recover(updater_.residualSigma(), &map_);
    result->pose->covariance = covariance_.follow(*solution, known);
    result->state = TrackingState::kTracking;
    tracker_.commit(*result->pose, time.monotonic_ns);
  }

  // Sections 4.3 and 4.8. Empty where the markers give no pose that is believed.
  std::optional<TrackedFrame> track(std::span<const MarkerDetection> usable,
                                    const FrameInput& frame,
                                    const std::optional<Prediction>& prediction,
                                    StageObserver* observer, FrameResult* result) {
    auto tracked = trackMarkers(usable, frame.time, prediction, observer, result);
    if (!tracked) return std::nullopt;
    PoseEstimate pose = tracker_.estimateOf(*tracked);
    if (!follow(*tracked, pose, frame, observer)) {
      result->reason = NoPoseReason::kMarkersDoNotFit;
      return std::nullopt;
    }
    const StageScope scope(observer, Stage::kTrack);
    pose.covariance =
        covariance_.follow(tracked->solution, tracked->eligible) + coverOfOtherPose(*tracked);
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
    decideLost(outcome);
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

  [[nodiscard]] bool hasFeatures(const FrameInput& frame) const {
    return options_.natural.enabled && frame.image;
  }

  // Natural features follow the markers. False where they know better.
  bool follow(const TrackedFrame& tracked, const PoseEstimate& pose, const FrameInput& frame,
              StageObserver* observer) {
    if (!hasFeatures(frame)) return true;
    const StageScope scope(observer, Stage::kFeatures);
    fitting_known_.clear();
    for (std::size_t i = 0; i < tracked.eligible.size(); ++i) {
      if (tracked.solution.inlier[i]) fitting_known_.push_back(tracked.eligible[i]);
    }
    return integrator_.follow(frame.time.monotonic_ns, *frame.image, pose, isCertain(tracked),
                              fitting_known_);
  }

  // Seed 2, section 3.3: between the markers.
  void bridge(const FrameInput& frame, StageObserver* observer, FrameResult* result) {
    if (!hasFeatures(frame)) return;
    const StageScope scope(observer, Stage::kFeatures);
    result->pose = integrator_.bridge(frame.time.monotonic_ns, *frame.image);
    if (!result->pose) return;
    result->pose->covariance += covariance_.sharedAt(result->pose->T_w_c.p);
    result->state = TrackingState::kBridging;
    result->reason = NoPoseReason::kNone;
    tracker_.commit(*result->pose, frame.time.monotonic_ns);
  }

  // The map's uncertainty follows its changes, in slices.
  void followMap(StageObserver* observer, FrameResult* result) {
    const StageScope scope(observer, Stage::kMap);
    if (result->map_changed || result->keyframe_added) covariance_.noteChange();
    if (covariance_.work(updater_.residualSigma(), &map_)) result->map_changed = true;
  }

  // What comes now may be at a loop's other end.
  void decideLost(const TrackingOutcome& outcome) {
    if (!outcome.lost_place) return;
    local_.reset();
    updater_.cancelLoopClosure();
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
  IntrinsicVector given_intrinsics_;
  Counters counters_;
  MarkerFollower follower_;
  MarkerScreening screening_;
  Initializer initializer_;
  RollingShutterEstimator rolling_shutter_;
  LocalMarkers local_;
  MarkerExpectation expectation_;
  FrameTracker tracker_;
  MapUpdater updater_;
  RecordedFrameLocator locator_;
  Map map_;
  MapCovariance covariance_;
  PoseIntegrator integrator_;
  std::vector<KnownMarker> fitting_known_;  // reused from frame to frame
  KeyframeId last_old_keyframe_;            // of the map given at the start; -1 for none
  bool world_is_fixed_ = false;             // what fixes it has had a place in the map
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
void Slam::densify(std::span<const RecordedFrame> frames) { impl_->densify(frames); }
void Slam::finish() { impl_->finish(); }
void Slam::optimizeGlobally() { impl_->optimizeMapGlobally(); }
void Slam::optimizeGloballyWithIntrinsics() { impl_->optimizeMapAndLens(); }

std::optional<PoseEstimate> Slam::localize(const RecordedFrame& frame) const {
  return impl_->localize(frame);
}

std::optional<PosesOfOneMarker> Slam::localizeByOneMarker(const RecordedFrame& frame) const {
  return impl_->localizeByOneMarker(frame);
}

double Slam::readout_s() const { return impl_->readout_s(); }

}  // namespace waymark::slam
