#include "slam/slam.h"

#include <algorithm>
#include <utility>

#include "base/sorted.h"
#include "base/task.h"
#include "slam/loop_closure/loop_detector.h"
#include "slam/loop_closure/loop_keeper.h"
#include "slam/tracking/expected_markers.h"
#include "slam/tracking/sight.h"

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
        initialiser_(options.markers, camera_.focalLength(), options.initialisation),
        tracker_(camera_.focalLength(), options.tracking),
        mapper_(options.markers, camera_.focalLength(), options.mapper),
        watch_(options.markers, options.watch),
        readout_(options.shutter, options.markers),
        loops_(options_, camera_, tracker_.optimiser(), loop_detector_, &watch_, &counters_),
        locator_(watch_, camera_, readout_, tracker_),
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
    sight_.time = time;
    watch_.screen(detections, camera_, map_, &sight_.detections, &counters_);
    if (map_.empty()) {
      const StageScope scope(observer, Stage::kMap);
      initialise(sight_.detections, time, &result);
    } else {
      look();
      {
        const StageScope scope(observer, Stage::kTrack);
        track(&sight_, &result);
      }
      if (options_.mapping) {
        const StageScope scope(observer, Stage::kMap);
        if (result.pose) loops_.meet(map_, mapper_.noise(), &sight_);  // section 4.9
        if (result.pose) updateMap(&sight_, &result);
        // Also after a new keyframe: in fast motion every frame is one.
        work(options_.work_per_frame);
      }
    }
    if (result.pose) ++counters_.localized;
    return result;
  }

  void finish() {
    while (options_.mapping && !idle()) {
      work(kPlenty);
      FrameResult nobodys;
      collectWork(&nobodys);
    }
  }

  void addViews(std::span<const PastFrame> frames) {
    finish();
    if (options_.mapping) {
      locator_.addViews(frames, last_old_keyframe_, &map_);
      mapper_.resolveAll(&map_);
    }
  }

  void optimiseMapGlobally() {
    finish();
    if (options_.mapping && !map_.keyframes().empty()) {
      (void)slam::optimiseGlobally(&map_, options_.markers, options_.global_optimisation);
    }
  }

  void optimiseMapAndLens() {
    finish();
    if (!options_.mapping || map_.keyframes().empty()) return;
    (void)slam::optimiseGloballyWithIntrinsics(&map_, options_.markers, given_intrinsics_,
                                               options_.intrinsics, readout_.seconds(),
                                               options_.global_optimisation, &camera_);
  }

  [[nodiscard]] std::optional<PoseEstimate> localize(const PastFrame& frame) const {
    const auto located = locator_.locate(map_, frame);
    if (!located) return std::nullopt;
    return tracker_.estimateOf(located->solution, located->known, frame.twist);
  }

  [[nodiscard]] const Map& map() const { return map_; }
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const CameraModel& camera() const { return camera_; }
  [[nodiscard]] double readout_s() const { return readout_.seconds(); }

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
      expected_ids_.push_back(followed.sighting.detection.id);
    }
    sortUnique(&expected_ids_);
    slam::expectMarkers(map_, expected_ids_, *before, *now, &expected_);
  }

  [[nodiscard]] bool workIsDone() const {
    return mapper_.isDone() || readout_.isDone() || loops_.isDone();
  }

  // What was under way and is done goes into the map before the next frame is tracked in it.
  void collectWork(FrameResult* result) {
    if (const auto T_now_was = mapper_.collect(&map_, &counters_)) moved(*T_now_was, result);
    if (const auto T_now_was = readout_.collect(camera_, options_.loops.optimisation, &map_)) {
      moved(*T_now_was, result);
    }
    if (const auto T_now_was = loops_.collect(&map_)) {
      moved(*T_now_was, result);
      result->keyframe_added = true;
      loop_detector_.forget();
    }
  }

  // The map moved under the camera.
  void moved(const Transform& T_now_was, FrameResult* result) {
    if (const auto last = tracker_.lastPose()) tracker_.correct(T_now_was * *last);
    result->map_changed = true;
  }

  // A slice of what is under way: at least half of it is for what is larger than the neighbourhood
  // of a keyframe, where there is such a thing.
  void work(double units) {
    const bool local_only = loops_.idle() && readout_.idle(map_);
    const double for_local = local_only ? units : 0.5 * units;
    const double unspent = std::max(mapper_.work(for_local, map_), 0.0);
    const double rest = units - for_local + unspent;
    if (loops_.idle()) {
      readout_.work(rest, camera_, map_, options_.loops.optimisation);
    } else {
      loops_.work(rest);
    }
  }

  [[nodiscard]] bool idle() const { return mapper_.idle() && readout_.idle(map_) && loops_.idle(); }

  // What sight_'s detections are good for.
  void look() {
    sight_.fitting.clear();
    sight_.closes_loop = false;
    const std::int64_t now_ns = sight_.time.monotonic_ns;
    if (const auto predicted = tracker_.predict(now_ns)) {
      deskew(*predicted, tracker_.twistTo(*predicted, now_ns), &sight_.detections);
    }
    split(&sight_);
  }

  void split(Sight* sight) {
    findKnownMarkers(map_, sight->detections, &known_);
    loop_detector_.split(known_, &sight->known);
    // Nothing eligible: not a closing loop, but another place. Relocalise there.
    if (sight->known.eligible.empty()) std::swap(sight->known.eligible, sight->known.loop);
  }

  void deskew(const Transform& T_w_c, const Twist& twist,
              std::vector<MarkerDetection>* detections) const {
    readout_.deskew(camera_, map_, T_w_c, twist, detections);
  }

  // Section 4.1.
  void initialise(const std::vector<MarkerDetection>& usable, const FrameTime& time,
                  FrameResult* result) {
    result->state = TrackingState::kInitializing;
    if (!options_.mapping) {
      result->reason = "there is no map, and mapping is off";
      return;
    }
    const auto start =
        initialiser_.process({-1, time.sequence, time.monotonic_ns, Transform{}, usable});
    if (!start) {
      result->reason = initialiser_.reason();
      return;
    }
    const Transform T_w_c = mapper_.begin(*start, &map_, &counters_);
    result->map_changed = result->keyframe_added = true;
    const std::vector<KnownMarker> known = knownMarkers(map_, usable);
    const auto solution = tracker_.optimiser().optimise(known, T_w_c);
    if (!solution) return;
    result->pose = tracker_.estimateOf(*solution, known, Twist::Zero());
    result->pose->T_w_c = T_w_c;  // of a keyframe: by definition of the world, or as optimised
    result->state = TrackingState::kTracking;
    tracker_.commit(T_w_c, time.monotonic_ns);
  }

  // Sections 4.3 and 4.8, with the eligible markers only (Eq. 36).
  void track(Sight* sight, FrameResult* result) {
    result->state = TrackingState::kRelocalizing;
    if (sight->known.eligible.empty()) {
      result->reason =
          sight->detections.empty() ? "no marker in view" : "no marker in view has a pose yet";
      lose();
      return;
    }
    const std::int64_t now_ns = sight->time.monotonic_ns;
    auto tracked = tracker_.track(sight->known.eligible, now_ns);
    if (!tracked && !sight->known.loop.empty()) {
      // Lost for what is near; but the map knows other markers in view.
      lose();
      split(sight);
      tracked = tracker_.track(sight->known.eligible, now_ns);
    }
    if (!tracked) {
      ++counters_.rejected_poses;
      result->reason = sight->known.eligible.size() == 1
                           ? "the only known marker in view is ambiguous"
                           : "the markers in view do not fit the map";
      lose();
      return;
    }
    if (tracked->prediction_refused) ++counters_.rejected_poses;
    if (tracked->method == TrackingMethod::kRelocalised) ++counters_.relocalizations;
    sight->solution = std::move(tracked->solution);
    sight->twist = tracker_.twistTo(sight->solution.T_w_c, now_ns);
    deskewAgain(sight);
    sortByFit(sight);
    result->pose = tracker_.estimateOf(sight->solution, sight->known.eligible, sight->twist);
    result->state = TrackingState::kTracking;
    tracker_.commit(sight->solution.T_w_c, now_ns);
  }

  // What was near is not near any more, perhaps; and what comes now may be at a loop's other end.
  void lose() {
    loop_detector_.forget();
    loops_.forget();
  }

  // With the velocity this frame has shown, instead of the predicted one.
  void deskewAgain(Sight* sight) {
    if (readout_.seconds() == 0.0) return;
    deskew(sight->solution.T_w_c, sight->twist, &sight->detections);
    auto better = tracker_.optimiser().optimise(sight->known.eligible, sight->solution.T_w_c);
    if (!better || !tracker_.optimiser().acceptable(*better)) return;
    sight->solution = std::move(*better);
    sight->twist = tracker_.twistTo(sight->solution.T_w_c, sight->time.monotonic_ns);
  }

  // Fills `fitting` with the detections that agree with the pose, and with those the map has no
  // pose for; tells the watch of the others.
  void sortByFit(Sight* sight) {
    for (const MarkerDetection& detection : sight->detections) {
      if (map_.findPosed(detection.id) == nullptr) sight->fitting.push_back(detection);
    }
    const std::vector<KnownMarker>& known = sight->known.eligible;
    const bool others_agree = sight->solution.inliers >= 2;
    for (std::size_t i = 0; i < known.size(); ++i) {
      if (sight->solution.inlier[i]) {
        sight->fitting.push_back(*known[i].detection);
      } else {
        ++counters_.rejected_markers;
      }
      // A frame may be stricter than the map is sure of itself.
      const bool agrees =
          sight->solution.inlier[i] ||
          tracker_.optimiser().explains(known[i], sight->solution.T_w_c, mapper_.noise());
      if (agrees || others_agree) {
        watch_.record(known[i].detection->id, agrees, sight->time.monotonic_ns);
      }
    }
    sortById(&sight->fitting);
  }

  // Sections 4.2 and 4.4 to 4.7, and what the watch has noticed.
  void updateMap(Sight* sight, FrameResult* result) {
    bool changed = watch_.refuseDoubled(&map_, &counters_);
    if (loops_.haveMoved(map_, *sight)) {
      changed = watch_.quarantineMoved(&map_, &counters_) || changed;
    }
    if (changed) {
      std::erase_if(sight->fitting, [&](const MarkerDetection& d) {
        const MapMarker* marker = map_.find(d.id);
        return marker != nullptr && marker->state == MarkerState::kRefused;
      });
      result->map_changed = true;
    }
    const Transform& T_w_c = result->pose->T_w_c;
    const bool grown = !sight->fitting.empty() &&
                       (sight->closes_loop || mapper_.wants(sight->fitting, T_w_c, map_));
    if (grown) {
      mapper_.insert(sight->frameAt(T_w_c), &map_, &counters_);
      result->map_changed = result->keyframe_added = true;
      for (const MarkerDetection& detection : sight->fitting) {
        watch_.checkReturned(detection.id, &map_, &counters_);
      }
    }
    const double depth_m = medianDepth(map_, sight->fitting, T_w_c).value_or(1.0);
    loop_detector_.follow(map_, sight->fitting, T_w_c, depth_m, options_.mapper.keyframes);
  }

  Options options_;
  CameraModel camera_;
  IntrinsicVector given_intrinsics_;
  MarkerFollower follower_;
  Initialiser initialiser_;
  Tracker tracker_;
  Mapper mapper_;
  LoopDetector loop_detector_;
  MarkerWatch watch_;
  Readout readout_;
  LoopKeeper loops_;
  PastFrameLocator locator_;
  Map map_;
  // Reused from frame to frame.
  Sight sight_;
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
void Slam::addViews(std::span<const PastFrame> frames) { impl_->addViews(frames); }
void Slam::finish() { impl_->finish(); }
void Slam::optimiseGlobally() { impl_->optimiseMapGlobally(); }
void Slam::optimiseGloballyWithIntrinsics() { impl_->optimiseMapAndLens(); }

std::optional<PoseEstimate> Slam::localize(const PastFrame& frame) const {
  return impl_->localize(frame);
}

double Slam::readout_s() const { return impl_->readout_s(); }

}  // namespace waymark::slam
