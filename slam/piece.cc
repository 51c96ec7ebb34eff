#include "slam/piece.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "base/task.h"
#include "slam/batch_mapper.h"
#include "slam/camera/lens_estimator.h"
#include "slam/camera/lens_watch.h"
#include "slam/camera/rolling_shutter_estimator.h"
#include "slam/camera/undistort_map.h"
#include "slam/covariance/map_covariance.h"
#include "slam/covariance/marginals.h"
#include "slam/covariance/pose_by_camera.h"
#include "slam/feature_stage.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/map/world_reference.h"
#include "slam/map_start.h"
#include "slam/mapping/gap_mapper.h"
#include "slam/mapping/map_updater.h"
#include "slam/marker_screening/marker_screening.h"
#include "slam/picture_stage.h"
#include "slam/tracking/frame_tracker.h"

namespace waymark::slam {
namespace {

// As the pieces before or the map's run have left it: with as many keyframes that has looked for a
// readout time, and 0 says that there was none to be believed.
RollingShutterOptions asLearned(RollingShutterOptions options, const ReadoutEstimate& readout,
                                const Map& map) {
  options.learned_s = readout.readout_s;
  options.unknown_s = std::min(options.unknown_s, readout.sigma_s);
  if (static_cast<int>(map.keyframes().size()) >= options.first_keyframes) {
    options.unknown_s = std::min(options.unknown_s, options.min_s);
  }
  return options;
}

}  // namespace

class Piece::Impl {
 public:
  Impl(const PieceParts& parts, Map map)
      : options_(parts.options),
        camera_(*parts.camera),
        counters_(*parts.counters),
        screening_(options_.markers, options_.screening),
        rolling_shutter_(asLearned(options_.shutter, parts.readout, map), options_.markers),
        lens_known_(*parts.lens),
        lens_(options_.lens, options_.markers, parts.camera, parts.lens),
        lens_watch_(options_.lens, options_.markers, options_.mapping, parts.camera, parts.lens),
        tracker_(camera_, options_.tracking, rolling_shutter_),
        updater_(
            {options_.markers, options_.mapper, options_.loops, options_.tracking.relocalization},
            camera_, tracker_.tracker().optimizer(), local_, &screening_, &rolling_shutter_, &lens_,
            &counters_),
        map_(std::move(map)),
        covariance_(options_.markers, options_.covariance, camera_uncertainty_, map_,
                    options_.mapping),
        features_(options_, camera_, covariance_, &counters_),
        pictures_({options_, camera_uncertainty_, rolling_shutter_, &updater_, &covariance_,
                   &features_, &map_, &counters_}),
        world_(options_.markers),
        start_({options_, camera_, tracker_.tracker(), &updater_, &covariance_, &map_}),
        batch_({options_, screening_, rolling_shutter_, tracker_.tracker(), parts.camera,
                *parts.lens, camera_uncertainty_, &updater_, &covariance_, &map_}) {
    noteCamera();
  }

  // The stages of seed 1, Fig. 4, in its order.
  FrameResult process(const FrameInput& frame, std::span<const MarkerDetection> detections,
                      Turn turn, double work, StageObserver* observer) {
    FrameResult result;
    if (pictures_.hear(turn == Turn::kOwn ? frame.late : std::span<const LateResult>(), observer)) {
      result.map_changed = true;
    }
    const std::uint64_t epoch = map_.epoch();
    if (!held_ && updater_.hasFinishedWork()) {
      const StageScope scope(observer, Stage::kMap);
      if (collectWork(&result).lens_changed) detections = undistorted(detections);
    }
    if (!held_ && lens_watch_.collect(rolling_shutter_)) {
      if (options_.mapping) undistortAgain();
      noteLens();
      detections = undistorted(detections);
    }
    noteCamera();
    features_.setReadout(rolling_shutter_.seconds());
    result.detections = detections;
    const auto prediction = tracker_.predict(frame.time.monotonic_ns);  // in the newest coordinates
    Counters nobodys;
    const auto usable =
        screening_.screen(detections, camera_, map_, turn == Turn::kOwn ? &counters_ : &nobodys);
    std::optional<TrackedFrame> tracked;
    if (map_.empty()) {
      initialize(usable, frame, turn, observer, &result);
    } else {
      tracked = track(usable, frame, prediction, observer, &result);
      if (!tracked && turn == Turn::kOwn) bridge(usable, frame, prediction, observer, &result);
      if (options_.mapping) {
        const StageScope scope(observer, Stage::kMap);
        if (tracked) leaveGap(*tracked, &result);
        if (tracked && !held_) grow(*tracked, &result);
        // Also after a new keyframe: in fast motion every frame is one. Moving all of a large map
        // was this frame's work.
        if (!held_ && map_.epoch() == epoch) updater_.work(work, map_);
      }
      followMap(!held_ && map_.epoch() == epoch, observer, &result);
      if (tracked && turn == Turn::kOwn) watchLens(*tracked, observer);
    }
    if (result.pose) result.pose->piece = map_.piece;
    if (turn == Turn::kOwn) {
      const auto fitting = tracked ? tracked->fitting : std::span<const MarkerDetection>();
      if (pictures_.await(frame, result, fitting, observer)) result.map_changed = true;
    }
    if (turn == Turn::kOwn && options_.mapping && world_.isMissing(map_)) {
      ++counters_.frames_in_other_world;
    }
    return result;
  }

  void setElsewhere(int marker_id, bool elsewhere) {
    const MapMarker& marker = map_.addMarker(marker_id, options_.markers.sizeOf(marker_id));
    if (marker.T_w_m || marker.state == MarkerState::kBanned) return;
    if ((marker.state == MarkerState::kElsewhere) == elsewhere) return;
    map_.setElsewhere(marker_id, elsewhere);
  }

  void ban(int marker_id) {
    const MapMarker* const marker = map_.find(marker_id);
    if (marker == nullptr || marker->state == MarkerState::kBanned) return;
    map_.ban(marker_id);
    map_.removeViews(marker_id, map_.viewsOf(marker_id));
    covariance_.noteChange();
  }

  [[nodiscard]] JointParts jointParts() const {
    return {tracker_.tracker().optimizer(), options_.tracking.relocalization.square, camera_,
            options_.pieces};
  }

  void hold(bool held) { held_ = held; }

  [[nodiscard]] Map adopt(JoinedMap joined) {
    Map was = std::exchange(map_, std::move(joined.map));
    updater_.noteJoint(joined.newest);
    covariance_.noteChange();
    local_.reset();
    return was;
  }
  [[nodiscard]] Map takeMap() { return std::exchange(map_, {}); }
  bool letGo(int count) { return covariance_.letGo(count); }

  void comeIn(const PoseEstimate& pose, std::int64_t time_ns) {
    tracker_.commit(pose, time_ns);
    local_.reset();
  }

  void undistortAgain() {
    slam::undistortAgain(camera_, rolling_shutter_.seconds(), &map_, lens_known_.since_ns);
    noteLens();
  }

  bool estimateLens() {
    if (!options_.mapping) return false;
    (void)batch();
    const bool changed = lens_.estimateNow(rolling_shutter_, options_.global_optimization, &map_);
    if (changed) noteLens();
    return changed;
  }

  [[nodiscard]] BatchMapper& batch() {
    while (options_.mapping && !updater_.idle(map_)) {
      updater_.work(kUnlimited, map_);
      FrameResult nobodys;
      (void)collectWork(&nobodys);
    }
    noteCamera();
    return batch_;
  }
  [[nodiscard]] const BatchMapper& batch() const { return batch_; }

  [[nodiscard]] const Map& map() const { return map_; }
  [[nodiscard]] const LocalMarkers& local() const { return local_; }
  [[nodiscard]] std::optional<Prediction> predict(std::int64_t time_ns) const {
    return tracker_.predict(time_ns);
  }
  [[nodiscard]] ReadoutEstimate readout() const {
    return {rolling_shutter_.seconds(), rolling_shutter_.sigma_s()};
  }

 private:
  // What was under way and is done goes into the map before the next frame is tracked in it.
  FinishedWork collectWork(FrameResult* result) {
    const FinishedWork finished = updater_.collect(&map_);
    for (const Transform& T_new_old : finished.T_new_old) {
      tracker_.correct(T_new_old);
      features_.moveWorld(T_new_old);
      pictures_.moveWorld(T_new_old);
    }
    if (!finished.T_new_old.empty()) result->map_changed = true;
    result->keyframe_added = finished.loop_closed;
    if (finished.loop_closed) local_.reset();
    if (finished.lens_changed) noteLens();
    return finished;
  }

  // What was found in this frame, through the lens that is in use since.
  std::span<const MarkerDetection> undistorted(std::span<const MarkerDetection> detections) {
    undistorted_.assign(detections.begin(), detections.end());
    slam::undistortAgain(camera_, &undistorted_);
    return undistorted_;
  }

  // What is known of it by now.
  void noteCamera() {
    GlobalMatrix& covariance = camera_uncertainty_.covariance;
    covariance.setZero();
    covariance.topLeftCorner<9, 9>() = lens_known_.covariance;
    covariance(9, 9) = rolling_shutter_.sigma_s() * rolling_shutter_.sigma_s();
    camera_uncertainty_.since_ns = lens_known_.since_ns;
  }

  // What was seen through another lens: its noise, where it has put the features, and what seemed
  // to have moved.
  void noteLens() {
    tracker_.forgetNoise();
    if (options_.mapping) screening_.forgetMoves(&map_);
    features_.forget();
    noteCamera();
    covariance_.noteChange();
    if (options_.mapping) lens_watch_.forget();
  }

  // Section 4.1.
  void initialize(std::span<const MarkerDetection> usable, const FrameInput& frame, Turn turn,
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
    } else if (pictures_.any() && turn == Turn::kOwn && pictures_.begin(frame, observer)) {
      result->map_changed = result->keyframe_added = true;
      bridge(usable, frame, {}, observer, result);
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
    if (!features_.follow(frame, *tracked, pose, map_, observer)) {
      result->reason = NoPoseReason::kMarkersDoNotFit;
      return std::nullopt;
    }
    const StageScope scope(observer, Stage::kTrack);
    pose.covariance = covariance_.follow(tracked->solution, tracked->eligible) + coverOf(*tracked);
    if (const auto fused = features_.fused()) pose = *fused;
    addCamera(*tracked, &pose);
    result->pose = pose;
    result->state = TrackingState::kTracking;
    tracker_.commit(pose, frame.time.monotonic_ns);
    return tracked;
  }

  void watchLens(const TrackedFrame& frame, StageObserver* observer) {
    const StageScope scope(observer, Stage::kMap);
    lens_watch_.look(frame.time, frame.solution.T_w_c, frame.twist, frame.eligible);
    const double share = updater_.loopsIdle() ? 1.0 : options_.lens.watch.share_beside_loops;
    lens_watch_.work(share * options_.lens.watch.cost_per_frame, rolling_shutter_,
                     options_.loops.optimization);
  }

  // What is not known of a lens or a readout time that is learned: it moves the pose, and the map
  // that the pose is found from.
  void addCamera(const TrackedFrame& frame, PoseEstimate* pose) const {
    const PoseGlobalMatrix in_view = poseByCamera(
        frame.solution, frame.eligible, camera_uncertainty_, frame.twist, frame.time.monotonic_ns);
    const PoseGlobalMatrix in_world = in_view + covariance_.sharedByCamera(frame.solution.T_w_c.p);
    pose->covariance += covarianceByCamera(camera_uncertainty_, in_world);
    pose->view_covariance += covarianceByCamera(camera_uncertainty_, in_view);
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
      updater_.notePlaceLost();
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
              const std::optional<Prediction>& prediction, StageObserver* observer,
              FrameResult* result) {
    deskewed_.assign(usable.begin(), usable.end());
    if (prediction) {
      rolling_shutter_.deskew(camera_, map_, prediction->T_w_c, prediction->twist, &deskewed_);
    }
    result->pose = pictures_.bridge(frame, deskewed_, observer);
    if (!result->pose) return features_.tellIfLost(result);
    const PoseGlobalMatrix by_camera = covariance_.sharedByCamera(result->pose->T_w_c.p);
    result->pose->covariance += covarianceByCamera(camera_uncertainty_, by_camera);
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
    if (linkElsewhere(usable, time, pose)) result->keyframe_added = true;
    const auto joined = updater_.growThroughGap(
        {time, usable, pose.T_w_c, pose.view_covariance, pose.twist, pictures_.anchor()}, &map_);
    if (!joined) return;
    covariance_.introduce(*joined, pose.T_w_c, pose.covariance, &map_);
    result->map_changed = result->keyframe_added = true;
  }

  // A marker of another piece, seen from a carried pose: a keyframe that hangs by a link to what
  // the pose is relative to, and connects the two. A few for each such marker, that share their
  // drift.
  bool linkElsewhere(std::span<const MarkerDetection> usable, const FrameTime& time,
                     const PoseEstimate& pose) {
    const MapMarker* const anchor = map_.findPosed(pictures_.anchor());
    const PieceOptions::Bridge& bridge = options_.pieces.bridge;
    if (anchor == nullptr ||
        time.monotonic_ns - last_link_ns_ < std::llround(1e9 * bridge.interval_s)) {
      return false;
    }
    std::vector<MarkerDetection> theirs;
    for (const MarkerDetection& detection : usable) {
      const MapMarker* const marker = map_.find(detection.id);
      if (marker == nullptr || marker->state != MarkerState::kElsewhere) continue;
      const auto linked = std::ranges::count_if(map_.viewsOf(detection.id), [&](KeyframeId id) {
        return !map_.keyframes().at(id).links.empty();
      });
      if (linked < bridge.links) theirs.push_back(detection);
    }
    if (theirs.empty()) return false;
    const auto link = linkTo(anchor->id, *anchor->T_w_m, pose.T_w_c,
                             static_cast<double>(bridge.links) * pose.view_covariance);
    if (!link) return false;
    last_link_ns_ = time.monotonic_ns;
    (void)map_.addKeyframe({.sequence = time.sequence,
                            .monotonic_ns = time.monotonic_ns,
                            .T_w_c = pose.T_w_c,
                            .detections = std::move(theirs),
                            .twist = pose.twist,
                            .links = {*link}});
    return true;
  }

  // A bridge has ended at markers of the map, or had before.
  void leaveGap(const TrackedFrame& frame, FrameResult* result) {
    const auto carriedTo = [&](const FilteredPose& pose, int anchor) {
      return CarriedFrame{.time = frame.time,
                          .detections = {},
                          .T_w_c = pose.T_w_c,
                          .covariance = pose.covariance,
                          .twist = frame.twist,
                          .anchor = anchor};
    };
    std::optional<CarriedFrame> carried_on;
    if (const auto pose = features_.carriedOn()) carried_on = carriedTo(*pose, -1);
    bool grown = updater_.growAfterGap(frame, carried_on, &map_);
    if (const auto arrival = features_.arrival()) {
      const CarriedFrame carried = carriedTo(arrival->pose, arrival->anchor);
      grown = updater_.growAtArrival(frame, carried, &map_) || grown;
    }
    if (grown) result->map_changed = result->keyframe_added = true;
  }

  // The map's uncertainty follows its changes, in slices.
  void followMap(bool has_time, StageObserver* observer, FrameResult* result) {
    const StageScope scope(observer, Stage::kMap);
    if (result->map_changed || result->keyframe_added) covariance_.noteChange();
    if (has_time && covariance_.work(updater_.residualSigma(), &map_)) result->map_changed = true;
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

  const Options& options_;
  const CameraModel& camera_;
  Counters& counters_;
  MarkerScreening screening_;
  RollingShutterEstimator rolling_shutter_;
  const LensKnowledge& lens_known_;
  LensEstimator lens_;
  LensWatch lens_watch_;
  LocalMarkers local_;
  FrameTracker tracker_;
  MapUpdater updater_;
  Map map_;
  CameraUncertainty camera_uncertainty_{.camera = &camera_};
  MapCovariance covariance_;
  FeatureStage features_;
  PictureStage pictures_;
  WorldReference world_;
  MapStart start_;
  BatchMapper batch_;
  std::vector<MarkerDetection> undistorted_;  // of a frame in which the lens has changed
  std::vector<MarkerDetection> deskewed_;     // of a frame without a pose from markers
  std::int64_t last_link_ns_ = 0;
  bool held_ = false;
};

Piece::Piece(const PieceParts& parts, Map map)
    : impl_(std::make_unique<Impl>(parts, std::move(map))) {}
Piece::~Piece() = default;

const Map& Piece::map() const { return impl_->map(); }
const LocalMarkers& Piece::local() const { return impl_->local(); }
std::optional<Prediction> Piece::predict(std::int64_t time_ns) const {
  return impl_->predict(time_ns);
}
ReadoutEstimate Piece::readout() const { return impl_->readout(); }

FrameResult Piece::process(const FrameInput& frame, std::span<const MarkerDetection> detections,
                           Turn turn, double work, StageObserver* observer) {
  return impl_->process(frame, detections, turn, work, observer);
}

void Piece::setElsewhere(int marker_id, bool elsewhere) {
  impl_->setElsewhere(marker_id, elsewhere);
}
void Piece::ban(int marker_id) { impl_->ban(marker_id); }
JointParts Piece::jointParts() const { return impl_->jointParts(); }
void Piece::hold(bool held) { impl_->hold(held); }
Map Piece::adopt(JoinedMap joined) { return impl_->adopt(std::move(joined)); }
Map Piece::takeMap() { return impl_->takeMap(); }
bool Piece::letGo(int count) { return impl_->letGo(count); }
void Piece::comeIn(const PoseEstimate& pose, std::int64_t time_ns) { impl_->comeIn(pose, time_ns); }
void Piece::undistortAgain() { impl_->undistortAgain(); }
bool Piece::estimateLens() { return impl_->estimateLens(); }
BatchMapper& Piece::batch() { return impl_->batch(); }
const BatchMapper& Piece::batch() const { return std::as_const(*impl_).batch(); }

}  // namespace waymark::slam
