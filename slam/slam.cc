#include "slam/slam.h"

#include <algorithm>
#include <utility>

#include "base/sorted.h"
#include "base/task.h"
#include "slam/loop_closure/loop_closure_manager.h"
#include "slam/loop_closure/loop_detector.h"
#include "slam/tracking/expected_markers.h"
#include "slam/tracking/frame_context.h"

namespace waymark::slam {
namespace {

// Brackets a stage for the caller's stopwatch.
class StageScope {
 public:
  StageScope(StageObserver* observer, Stage stage) : observer_(observer), stage_(stage) {
    if (observer_ != nullptr) observer_->begin(stage_);
  }
  ~StageScope() {
    if (observer_ != nullptr) observer_->end(stage_);
  }
  StageScope(const StageScope&) = delete;
  StageScope& operator=(const StageScope&) = delete;

 private:
  StageObserver* observer_;
  Stage stage_;
};

}  // namespace

class Slam::Impl {
 public:
  Impl(const CameraModel& camera, Dictionary dictionary, const Options& options, Map map)
      : options_(options),
        camera_(camera),
        given_intrinsics_(camera.intrinsics()),
        follower_(camera_, std::move(dictionary), options.detector, options.follower),
        initializer_(options.markers, camera_.focalLength(), options.initialization),
        tracker_(camera_.focalLength(), options.tracking),
        mapper_(options.markers, camera_.focalLength(), options.mapper),
        screening_(options.markers, options.screening),
        rolling_shutter_(options.shutter, options.markers),
        loops_(options_, camera_, tracker_.optimizer(), loop_detector_, &screening_, &counters_),
        locator_(screening_, camera_, rolling_shutter_, tracker_),
        map_(std::move(map)),
        last_old_keyframe_(map_.keyframes().empty() ? -1 : map_.keyframes().rbegin()->first) {
    map_.dictionary = follower_.dictionary().name();
  }

  FrameResult processFrame(const ImageView& image, const FrameTime& time, StageObserver* observer) {
    std::span<const MarkerDetection> detections;
    {
      const StageScope scope(observer, Stage::kDetect);
      expectMarkers(time.monotonic_ns);
      detections = follower_.find(image, time.monotonic_ns, expected_);
      ++(follower_.mode() == SearchMode::kFullScan ? counters_.full_scans
                                                   : counters_.followed_frames);
    }
    return processDetections(detections, time, observer);
  }

  // The stages of seed 1, Fig. 4, in its order.
  FrameResult processDetections(std::span<const MarkerDetection> detections, const FrameTime& time,
                                StageObserver* observer) {
    ++counters_.frames;
    FrameResult result;
    result.detections = detections;
    if (workIsDone()) {
      const StageScope scope(observer, Stage::kMap);
      collectWork(&result);
    }
    context_.time = time;
    screening_.screen(detections, camera_, map_, &context_.detections, &counters_);
    if (map_.empty()) {
      const StageScope scope(observer, Stage::kMap);
      initialize(context_.detections, time, &result);
    } else {
      look();
      {
        const StageScope scope(observer, Stage::kTrack);
        track(&context_, &result);
      }
      if (options_.mapping) {
        const StageScope scope(observer, Stage::kMap);
        if (result.pose) loops_.meet(map_, mapper_.residual_sigma(), &context_);  // section 4.9
        if (result.pose) updateMap(&context_, &result);
        // Also after a new keyframe: in fast motion every frame is one.
        work(options_.work_per_frame);
      }
    }
    if (result.pose) ++counters_.localized;
    return result;
  }

  void finish() {
    while (options_.mapping && !idle()) {
      work(kUnlimited);
      FrameResult nobodys;
      collectWork(&nobodys);
    }
  }

  void densify(std::span<const RecordedFrame> frames) {
    finish();
    if (options_.mapping) {
      locator_.densify(frames, last_old_keyframe_, &map_);
      mapper_.resolveAll(&map_);
    }
  }

  void optimizeMapGlobally() {
    finish();
    if (options_.mapping && !map_.keyframes().empty()) {
      (void)slam::optimizeGlobally(&map_, options_.markers, options_.global_optimization);
    }
  }

  void optimizeMapAndLens() {
    finish();
    if (!options_.mapping || map_.keyframes().empty()) return;
    (void)slam::optimizeGloballyWithIntrinsics(&map_, options_.markers, given_intrinsics_,
                                               options_.intrinsics, rolling_shutter_.seconds(),
                                               options_.global_optimization, &camera_);
  }

  [[nodiscard]] std::optional<PoseEstimate> localize(const RecordedFrame& frame) const {
    const auto located = locator_.locate(map_, frame);
    if (!located) return std::nullopt;
    return tracker_.estimateOf(located->solution, located->known, frame.twist);
  }

  [[nodiscard]] const Map& map() const { return map_; }
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const CameraModel& camera() const { return camera_; }
  [[nodiscard]] double readout_s() const { return rolling_shutter_.seconds(); }

 private:
  // Fills expected_ with the markers of the last frame and those near it in the map.
  void expectMarkers(std::int64_t time_ns) {
    expected_.clear();
    const auto before = tracker_.lastPose();
    const auto now = tracker_.predict(time_ns);
    if (!before || !now) return;
    const auto local = loop_detector_.localMarkers();
    expected_ids_.assign(local.begin(), local.end());
    for (const auto& followed : follower_.followed()) {
      expected_ids_.push_back(followed.measured.detection.id);
    }
    sortUnique(&expected_ids_);
    slam::expectMarkers(map_, expected_ids_, *before, *now, &expected_);
  }

  [[nodiscard]] bool workIsDone() const {
    return mapper_.isDone() || rolling_shutter_.isDone() || loops_.isDone();
  }

  // What was under way and is done goes into the map before the next frame is tracked in it.
  void collectWork(FrameResult* result) {
    if (const auto T_new_old = mapper_.collect(&map_, &counters_)) moved(*T_new_old, result);
    if (const auto T_new_old =
            rolling_shutter_.collect(camera_, options_.loops.optimization, &map_)) {
      moved(*T_new_old, result);
    }
    if (const auto T_new_old = loops_.collect(&map_)) {
      moved(*T_new_old, result);
      result->keyframe_added = true;
      loop_detector_.forget();
    }
  }

  // The map moved under the camera.
  void moved(const Transform& T_new_old, FrameResult* result) {
    if (const auto last = tracker_.lastPose()) tracker_.correct(T_new_old * *last);
    result->map_changed = true;
  }

  // A slice of what is under way: at least half of it is for what is larger than the neighbourhood
  // of a keyframe, where there is such a thing.
  void work(double cost) {
    const bool local_only = loops_.idle() && rolling_shutter_.idle(map_);
    const double for_local = local_only ? cost : 0.5 * cost;
    const double unspent = std::max(mapper_.work(for_local, map_), 0.0);
    const double rest = cost - for_local + unspent;
    if (loops_.idle()) {
      rolling_shutter_.work(rest, camera_, map_, options_.loops.optimization);
    } else {
      loops_.work(rest);
    }
  }

  [[nodiscard]] bool idle() const {
    return mapper_.idle() && rolling_shutter_.idle(map_) && loops_.idle();
  }

  // What sight_'s detections are good for.
  void look() {
    context_.fitting.clear();
    context_.closes_loop = false;
    const std::int64_t now_ns = context_.time.monotonic_ns;
    if (const auto predicted = tracker_.predict(now_ns)) {
      deskew(*predicted, tracker_.twistTo(*predicted, now_ns), &context_.detections);
    }
    split(&context_);
  }

  void split(FrameContext* context) {
    findKnownMarkers(map_, context->detections, &known_);
    loop_detector_.split(known_, &context->known);
    // Nothing eligible: not a closing loop, but another place. Relocalize there.
    if (context->known.eligible.empty()) std::swap(context->known.eligible, context->known.loop);
  }

  void deskew(const Transform& T_w_c, const Twist& twist,
              std::vector<MarkerDetection>* detections) const {
    rolling_shutter_.deskew(camera_, map_, T_w_c, twist, detections);
  }

  // Section 4.1.
  void initialize(const std::vector<MarkerDetection>& usable, const FrameTime& time,
                  FrameResult* result) {
    result->state = TrackingState::kInitializing;
    if (!options_.mapping) {
      result->reason = "there is no map, and mapping is off";
      return;
    }
    const auto start =
        initializer_.process({-1, time.sequence, time.monotonic_ns, Transform{}, usable});
    if (!start) {
      result->reason = initializer_.reason();
      return;
    }
    const Transform T_w_c = mapper_.begin(*start, &map_, &counters_);
    result->map_changed = result->keyframe_added = true;
    const std::vector<KnownMarker> known = knownMarkers(map_, usable);
    const auto solution = tracker_.optimizer().optimize(known, T_w_c);
    if (!solution) return;
    result->pose = tracker_.estimateOf(*solution, known, Twist::Zero());
    result->pose->T_w_c = T_w_c;  // of a keyframe: by definition of the world, or as optimized
    result->state = TrackingState::kTracking;
    tracker_.commit(T_w_c, time.monotonic_ns);
  }

  // Sections 4.3 and 4.8, with the eligible markers only (Eq. 36).
  void track(FrameContext* context, FrameResult* result) {
    result->state = TrackingState::kRelocalizing;
    if (context->known.eligible.empty()) {
      result->reason =
          context->detections.empty() ? "no marker in view" : "no marker in view has a pose yet";
      lose();
      return;
    }
    const std::int64_t now_ns = context->time.monotonic_ns;
    auto tracked = tracker_.track(context->known.eligible, now_ns);
    if (!tracked && !context->known.loop.empty()) {
      // Lost for what is near; but the map knows other markers in view.
      lose();
      split(context);
      tracked = tracker_.track(context->known.eligible, now_ns);
    }
    if (!tracked) {
      ++counters_.rejected_poses;
      result->reason = context->known.eligible.size() == 1
                           ? "the only known marker in view is ambiguous"
                           : "the markers in view do not fit the map";
      lose();
      return;
    }
    if (tracked->prediction_rejected) ++counters_.rejected_poses;
    if (tracked->method == TrackingMethod::kRelocalized) ++counters_.relocalizations;
    context->solution = std::move(tracked->solution);
    context->twist = tracker_.twistTo(context->solution.T_w_c, now_ns);
    deskewAgain(context);
    sortByFit(context);
    result->pose = tracker_.estimateOf(context->solution, context->known.eligible, context->twist);
    result->state = TrackingState::kTracking;
    tracker_.commit(context->solution.T_w_c, now_ns);
  }

  // What was near is not near any more, perhaps; and what comes now may be at a loop's other end.
  void lose() {
    loop_detector_.forget();
    loops_.forget();
  }

  // With the velocity this frame has shown, instead of the predicted one.
  void deskewAgain(FrameContext* context) {
    if (rolling_shutter_.seconds() == 0.0) return;
    deskew(context->solution.T_w_c, context->twist, &context->detections);
    auto better = tracker_.optimizer().optimize(context->known.eligible, context->solution.T_w_c);
    if (!better || !tracker_.optimizer().acceptable(*better)) return;
    context->solution = std::move(*better);
    context->twist = tracker_.twistTo(context->solution.T_w_c, context->time.monotonic_ns);
  }

  // Fills `fitting` with the detections that agree with the pose, and with those the map has no
  // pose for; tells the watch of the others.
  void sortByFit(FrameContext* context) {
    for (const MarkerDetection& detection : context->detections) {
      if (map_.findPosed(detection.id) == nullptr) context->fitting.push_back(detection);
    }
    const std::vector<KnownMarker>& known = context->known.eligible;
    const bool others_agree = context->solution.inliers >= 2;
    for (std::size_t i = 0; i < known.size(); ++i) {
      if (context->solution.inlier[i]) {
        context->fitting.push_back(*known[i].detection);
      } else {
        ++counters_.rejected_markers;
      }
      // A frame may be stricter than the map is sure of itself.
      const bool agrees = context->solution.inlier[i] ||
                          tracker_.optimizer().explains(known[i], context->solution.T_w_c,
                                                        mapper_.residual_sigma());
      if (agrees || others_agree) {
        screening_.record(known[i].detection->id, agrees, context->time.monotonic_ns);
      }
    }
    sortById(&context->fitting);
  }

  // Sections 4.2 and 4.4 to 4.7, and what the watch has noticed.
  void updateMap(FrameContext* context, FrameResult* result) {
    bool changed = screening_.banDuplicates(&map_, &counters_);
    if (loops_.haveMoved(map_, *context)) {
      changed = screening_.quarantineMoved(&map_, &counters_) || changed;
    }
    if (changed) {
      std::erase_if(context->fitting, [&](const MarkerDetection& d) {
        const MapMarker* marker = map_.find(d.id);
        return marker != nullptr && marker->state == MarkerState::kBanned;
      });
      result->map_changed = true;
    }
    const Transform& T_w_c = result->pose->T_w_c;
    const bool grown = !context->fitting.empty() &&
                       (context->closes_loop || mapper_.wants(context->fitting, T_w_c, map_));
    if (grown) {
      mapper_.insert(context->frameAt(T_w_c), &map_, &counters_);
      result->map_changed = result->keyframe_added = true;
      for (const MarkerDetection& detection : context->fitting) {
        screening_.checkReturned(detection.id, &map_, &counters_);
      }
    }
    const double depth_m = medianDepth(map_, context->fitting, T_w_c).value_or(1.0);
    loop_detector_.follow(map_, context->fitting, T_w_c, depth_m, options_.mapper.keyframes);
  }

  Options options_;
  CameraModel camera_;
  IntrinsicVector given_intrinsics_;
  MarkerFollower follower_;
  Initializer initializer_;
  Tracker tracker_;
  Mapper mapper_;
  LoopDetector loop_detector_;
  MarkerScreening screening_;
  RollingShutterEstimator rolling_shutter_;
  LoopClosureManager loops_;
  RecordedFrameLocator locator_;
  Map map_;
  // Reused from frame to frame.
  FrameContext context_;
  std::vector<KnownMarker> known_;
  std::vector<int> expected_ids_;
  std::vector<ExpectedMarker> expected_;
  KeyframeId last_old_keyframe_;  // of the map given at the start; -1 for none
  Counters counters_;
};

Slam::Slam(const CameraModel& camera, Dictionary dictionary, const Options& options, Map map)
    : impl_(std::make_unique<Impl>(camera, std::move(dictionary), options, std::move(map))) {}
Slam::~Slam() = default;

FrameResult Slam::processFrame(const ImageView& image, const FrameTime& time,
                               StageObserver* observer) {
  return impl_->processFrame(image, time, observer);
}

FrameResult Slam::processDetections(std::span<const MarkerDetection> detections,
                                    const FrameTime& time, StageObserver* observer) {
  return impl_->processDetections(detections, time, observer);
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

double Slam::readout_s() const { return impl_->readout_s(); }

}  // namespace waymark::slam
