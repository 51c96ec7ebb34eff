#include "slam/slam.h"

#include <algorithm>
#include <map>
#include <utility>

#include "slam/loop_closure/loop_closer.h"
#include "slam/loop_closure/loop_detector.h"
#include "slam/loop_closure/loop_evidence.h"

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
        detector_(camera_, std::move(dictionary), options.detector),
        initialiser_(options.markers, camera_.focalLength(), options.initialisation),
        tracker_(camera_.focalLength(), options.tracking),
        mapper_(options.markers, camera_.focalLength(), options.mapper),
        watch_(options.markers, options.watch),
        readout_s_(options.shutter.readout_s.value_or(options.shutter.learned_s)),
        next_readout_keyframes_(options.shutter.first_keyframes),
        map_(std::move(map)),
        last_old_keyframe_(map_.keyframes().empty() ? -1 : map_.keyframes().rbegin()->first) {
    map_.dictionary = detector_.dictionary().name();
  }

  FrameResult processFrame(const ImageView& image, const FrameTime& time, StageObserver* observer) {
    std::span<const MarkerDetection> detections;
    {
      const StageScope scope(observer, Stage::kDetect);
      detections = detector_.detect(image);
    }
    return processDetections(detections, time, observer);
  }

  // The stages of seed 1, Fig. 4, in its order.
  FrameResult processDetections(std::span<const MarkerDetection> detections, const FrameTime& time,
                                StageObserver* observer) {
    ++counters_.frames;
    FrameResult result;
    result.detections = detections;
    std::vector<MarkerDetection> usable = watch_.screen(detections, camera_, map_, &counters_);
    if (map_.empty()) {
      const StageScope scope(observer, Stage::kMap);
      initialise(usable, time, &result);
    } else {
      Sight sight = look(std::move(usable), time);
      {
        const StageScope scope(observer, Stage::kTrack);
        track(&sight, &result);
      }
      if (result.pose && options_.mapping) {
        const StageScope scope(observer, Stage::kMap);
        closeLoop(&sight, &result);
        updateMap(&sight, &result);
        if (result.keyframe_added) learnReadout(&result);
      }
    }
    if (result.pose) ++counters_.localized;
    return result;
  }

  void addViews(std::span<const PastFrame> frames) {
    if (!options_.mapping) return;
    std::map<std::int64_t, KeyframeId> in_map;  // by time; an old map's keyframes had another clock
    for (const auto& [id, keyframe] : map_.keyframes()) {
      if (id > last_old_keyframe_) in_map[keyframe.monotonic_ns] = id;
    }
    for (const PastFrame& frame : frames) {
      auto view = viewOf(frame);
      if (!view) continue;
      const auto known = in_map.find(frame.time.monotonic_ns);
      if (known == in_map.end()) {
        (void)map_.addKeyframe(std::move(*view));
        continue;
      }
      for (const MarkerDetection& detection : view->detections) {
        const Keyframe& keyframe = map_.keyframes().at(known->second);
        if (keyframe.find(detection.id) == nullptr) map_.addView(keyframe.id, detection);
      }
    }
  }

  void optimiseMapGlobally() {
    if (options_.mapping && !map_.keyframes().empty()) {
      (void)slam::optimiseGlobally(&map_, options_.markers, options_.global_optimisation);
    }
  }

  void optimiseMapAndLens() {
    if (!options_.mapping || map_.keyframes().empty()) return;
    (void)slam::optimiseGloballyWithIntrinsics(&map_, options_.markers, options_.intrinsics,
                                               readout_s_, options_.global_optimisation, &camera_);
  }

  [[nodiscard]] std::optional<PoseEstimate> localize(std::span<const MarkerDetection> detections,
                                                     const Transform& guess,
                                                     const Vector6d& twist) const {
    const std::vector<MarkerDetection> usable = usableAt(guess, twist, detections);
    const std::vector<KnownMarker> known = knownMarkers(map_, usable);
    const auto solution = locate(known, guess);
    if (!solution) return std::nullopt;
    return estimateOf(*solution, known, twist);
  }

  [[nodiscard]] const Map& map() const { return map_; }
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const CameraModel& camera() const { return camera_; }
  [[nodiscard]] double readout_s() const { return readout_s_; }

 private:
  [[nodiscard]] std::vector<MarkerDetection> usableAt(
      const Transform& T_w_c, const Twist& twist,
      std::span<const MarkerDetection> detections) const {
    Counters uncounted;
    MarkerWatch watch(options_.markers, options_.watch);
    std::vector<MarkerDetection> usable = watch.screen(detections, camera_, map_, &uncounted);
    deskew(T_w_c, twist, &usable);
    return usable;
  }

  [[nodiscard]] std::optional<PoseSolution> locate(std::span<const KnownMarker> known,
                                                   const Transform& guess) const {
    const PoseOptimiser& optimiser = tracker_.optimiser();
    auto solution = optimiser.optimise(known, guess);
    if (!solution || !optimiser.acceptable(*solution)) {
      // The guess may be from before a loop was closed.
      solution =
          relocalise(known, optimiser, camera_.focalLength(), options_.tracking.relocalisation);
    }
    if (!solution || !optimiser.acceptable(*solution)) return std::nullopt;
    return solution;
  }

  // A keyframe of the markers that fit the map; empty when the frame has no pose in it.
  [[nodiscard]] std::optional<Keyframe> viewOf(const PastFrame& frame) const {
    const std::vector<MarkerDetection> usable =
        usableAt(frame.T_w_c, frame.twist, frame.detections);
    const std::vector<KnownMarker> known = knownMarkers(map_, usable);
    const auto solution = locate(known, frame.T_w_c);
    if (!solution) return std::nullopt;
    Keyframe view{-1, frame.time.sequence, frame.time.monotonic_ns, solution->T_w_c,
                  {}, frame.twist};
    for (std::size_t i = 0; i < known.size(); ++i) {
      if (solution->inlier[i]) view.detections.push_back(*known[i].detection);
    }
    return view;
  }

  // What a frame shows, by what it is good for, and what has become of it so far.
  struct Sight {
    FrameTime time;
    std::vector<MarkerDetection> detections;  // usable ones, as at the middle row's time
    SplitMarkers known;                       // pointing into `detections`
    PoseSolution solution;                    // of the eligible markers
    Twist twist = Twist::Zero();
    std::vector<MarkerDetection> fitting;  // those that agree with the pose, sorted by id
    bool closes_loop = false;
  };

  [[nodiscard]] Sight look(std::vector<MarkerDetection> usable, const FrameTime& time) const {
    Sight sight;
    sight.time = time;
    sight.detections = std::move(usable);
    if (const auto predicted = tracker_.predict(time.monotonic_ns)) {
      deskew(*predicted, tracker_.twistTo(*predicted, time.monotonic_ns), &sight.detections);
    }
    split(&sight);
    return sight;
  }

  void split(Sight* sight) const {
    sight->known = loop_detector_.split(knownMarkers(map_, sight->detections));
    // Nothing eligible: not a closing loop, but another place. Relocalise there.
    if (sight->known.eligible.empty()) std::swap(sight->known.eligible, sight->known.loop);
  }

  // Moves the corners to where a global shutter would have seen them.
  void deskew(const Transform& T_w_c, const Twist& twist,
              std::vector<MarkerDetection>* detections) const {
    if (readout_s_ == 0.0) return;
    for (MarkerDetection& detection : *detections) {
      const MapMarker* marker = map_.find(detection.id);
      const auto better = deskewed(detection, camera_, T_w_c, twist,
                                   marker != nullptr ? marker->T_w_m : std::nullopt,
                                   options_.markers.sizeOf(detection.id), readout_s_);
      if (better) detection = *better;
    }
  }

  [[nodiscard]] static Keyframe frameOf(const Sight& sight, const Transform& T_w_c) {
    return {-1, sight.time.sequence, sight.time.monotonic_ns, T_w_c, sight.fitting, sight.twist};
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
    result->pose = estimateOf(*solution, known, Twist::Zero());
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
      loop_detector_.forget();
      return;
    }
    const std::int64_t now_ns = sight->time.monotonic_ns;
    auto tracked = tracker_.track(sight->known.eligible, now_ns);
    if (!tracked && !sight->known.loop.empty()) {
      // Lost for what is near; but the map knows other markers in view.
      loop_detector_.forget();
      split(sight);
      tracked = tracker_.track(sight->known.eligible, now_ns);
    }
    if (!tracked) {
      ++counters_.rejected_poses;
      result->reason = sight->known.eligible.size() == 1
                           ? "the only known marker in view is ambiguous"
                           : "the markers in view do not fit the map";
      loop_detector_.forget();
      return;
    }
    if (tracked->prediction_refused) ++counters_.rejected_poses;
    if (tracked->method == TrackingMethod::kRelocalised) ++counters_.relocalizations;
    sight->solution = std::move(tracked->solution);
    sight->twist = tracker_.twistTo(sight->solution.T_w_c, now_ns);
    deskewAgain(sight);
    sortByFit(sight);
    result->pose = estimateOf(sight->solution, sight->known.eligible, sight->twist);
    result->state = TrackingState::kTracking;
    tracker_.commit(sight->solution.T_w_c, now_ns);
  }

  // With the velocity this frame has shown, instead of the predicted one.
  void deskewAgain(Sight* sight) {
    if (readout_s_ == 0.0) return;
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
          sight->solution.inlier[i] || fits(known[i], sight->solution.T_w_c, mapper_.noise());
      if (agrees || others_agree) {
        watch_.record(known[i].detection->id, agrees, sight->time.monotonic_ns);
      }
    }
    sortById(&sight->fitting);
  }

  // A better readout time moves the corners of every keyframe, and so the map. The frame is its
  // newest keyframe.
  void learnReadout(FrameResult* result) {
    const RollingShutterOptions& shutter = options_.shutter;
    const int keyframes = static_cast<int>(map_.keyframes().size());
    if (shutter.readout_s || keyframes < next_readout_keyframes_) return;
    next_readout_keyframes_ = static_cast<int>(shutter.growth * keyframes) + 1;
    // While the shutter is not known well, the views that speak loudest of it fit worst.
    BundleOptions ungated = options_.loops.optimisation;
    ungated.view_chi2 = 0.0;
    const auto found = estimateReadout(map_, options_.markers, readout_s_, camera_,
                                       shutter.most_keyframes, ungated);
    if (!found || !believable(found->readout_s, found->sigma_s, readout_s_, shutter)) return;
    readout_s_ = found->readout_s;
    map_.undistortAgain(camera_, readout_s_);
    (void)slam::optimiseGlobally(&map_, options_.markers, ungated);
    moveTo(map_.keyframes().rbegin()->second.T_w_c, result);
    result->map_changed = true;
  }

  // Section 4.9: markers in view that the neighbourhood does not know close a loop. Where both ends
  // agree as well as corners can tell, there is nothing to correct, and the next keyframe joins
  // them; also where they agree as well as the map agrees with itself, and a correction is refused.
  void closeLoop(Sight* sight, FrameResult* result) {
    const std::vector<KnownMarker>& loop = sight->known.loop;
    if (loop.empty() || !loop_detector_.reference()) return;
    const auto fittingWithin = [&](double noise) {
      return fittingMarkers(loop, sight->solution.T_w_c, noise);
    };
    const std::vector<int> agreeing = fittingWithin(mapper_.noise());
    const bool ends_agree = 2 * agreeing.size() > loop.size();
    if (2 * fittingWithin(1.0).size() > loop.size()) {
      joinLoop(agreeing, sight);
      return;
    }
    if (!ends_agree && frames_to_next_attempt_ > 0) {
      --frames_to_next_attempt_;
      recordContradiction(*sight);
      return;
    }
    const std::optional<LoopRefusal> refusal = closeLoopTo(loop, sight, result);
    if (!refusal) {
      contradicting_marker_ = -1;
    } else if (ends_agree) {
      joinLoop(agreeing, sight);
    } else if (*refusal != LoopRefusal::kNoEvidence) {
      constexpr int kFramesBetweenAttempts = 10;
      frames_to_next_attempt_ = kFramesBetweenAttempts;
      ++counters_.loops_refused;
      const bool contradicted = *refusal == LoopRefusal::kContradicted;
      contradicting_marker_ = contradicted && loop.size() == 1 ? loop[0].detection->id : -1;
      recordContradiction(*sight);
    }
  }

  // Empty when the loop was closed.
  std::optional<LoopRefusal> closeLoopTo(std::span<const KnownMarker> markers, Sight* sight,
                                         FrameResult* result) {
    const LoopFrame candidate =
        loopEvidence(frameOf(*sight, sight->solution.T_w_c), *loop_detector_.reference(), markers,
                     tracker_.optimiser(), camera_.focalLength(), options_.tracking.relocalisation);
    auto outcome = slam::closeLoop(map_, candidate, options_.markers, options_.loops);
    if (const auto* refusal = std::get_if<LoopRefusal>(&outcome)) return *refusal;
    adopt(std::move(std::get<ClosedLoop>(outcome)), sight, result);
    return std::nullopt;
  }

  void adopt(ClosedLoop closed, Sight* sight, FrameResult* result) {
    map_ = std::move(closed.map);
    ++counters_.loop_closures;
    ++counters_.keyframes_added;
    moveTo(map_.keyframes().at(closed.keyframe).T_w_c, result);
    sight->fitting.clear();  // the frame is in the map already
    watch_.forget();
    loop_detector_.forget();
    result->map_changed = result->keyframe_added = true;
  }

  // Whether a pose explains the marker; noise: of the residuals, in units of the corners' own.
  [[nodiscard]] bool fits(const KnownMarker& marker, const Transform& T_w_c, double noise) const {
    const auto chi2 = PoseOptimiser::markerChi2(marker, T_w_c);
    return chi2 && *chi2 <= options_.tracking.pose.marker_chi2 * noise * noise;
  }

  // Ids of the markers that a pose explains.
  [[nodiscard]] std::vector<int> fittingMarkers(std::span<const KnownMarker> markers,
                                                const Transform& T_w_c, double noise) const {
    std::vector<int> fitting;
    for (const KnownMarker& marker : markers) {
      if (fits(marker, T_w_c, noise)) fitting.push_back(marker.detection->id);
    }
    return fitting;
  }

  void joinLoop(const std::vector<int>& agreeing, Sight* sight) {
    for (const KnownMarker& marker : sight->known.loop) {
      const int id = marker.detection->id;
      const bool agrees = std::binary_search(agreeing.begin(), agreeing.end(), id);
      watch_.record(id, agrees, sight->time.monotonic_ns);
      if (agrees) sight->fitting.push_back(*marker.detection);
      if (!agrees) ++counters_.rejected_markers;
    }
    sortById(&sight->fitting);
    sight->closes_loop = true;
    ++counters_.loops_without_drift;
  }

  // One marker that contradicts all others, whose loop was refused for that: it moved, or hangs
  // twice, more likely than they did. The watch hears of every frame, not only of the attempts.
  void recordContradiction(const Sight& sight) {
    const std::vector<KnownMarker>& loop = sight.known.loop;
    if (loop.size() != 1 || loop[0].detection->id != contradicting_marker_) return;
    if (sight.solution.inliers < 2) return;
    watch_.record(contradicting_marker_, false, sight.time.monotonic_ns);
  }

  // Markers that have disagreed for long moved, or the map around them did: a loop that went
  // unnoticed, because the markers at its end were known here already. That is tried first.
  bool closeLoopToMisfits(Sight* sight, FrameResult* result) {
    if (!loop_detector_.reference()) return false;
    std::vector<KnownMarker> misfits;
    for (std::size_t i = 0; i < sight->known.eligible.size(); ++i) {
      if (!sight->solution.inlier[i]) misfits.push_back(sight->known.eligible[i]);
    }
    return !misfits.empty() && !closeLoopTo(misfits, sight, result);
  }

  // Sections 4.2 and 4.4 to 4.7, and what the watch has noticed.
  void updateMap(Sight* sight, FrameResult* result) {
    bool changed = watch_.refuseDoubled(&map_, &counters_);
    if (watch_.suspectsMoved(map_) && !closeLoopToMisfits(sight, result)) {
      changed = watch_.quarantineMoved(&map_, &counters_) || changed;
    }
    if (changed) {
      std::erase_if(sight->fitting, [&](const MarkerDetection& d) {
        const MapMarker* marker = map_.find(d.id);
        return marker != nullptr && marker->state == MarkerState::kRefused;
      });
      result->map_changed = true;
    }
    if (!sight->fitting.empty()) {
      const auto moved = mapper_.update(frameOf(*sight, result->pose->T_w_c), sight->closes_loop,
                                        &map_, &counters_);
      if (moved) {
        moveTo(*moved, result);
        result->map_changed = result->keyframe_added = true;
        for (const MarkerDetection& detection : sight->fitting) {
          watch_.checkReturned(detection.id, &map_, &counters_);
        }
      }
    }
    const Transform& T_w_c = result->pose->T_w_c;
    const double depth_m = medianDepth(sight->known.eligible, T_w_c).value_or(1.0);
    loop_detector_.follow(map_, sight->fitting, T_w_c, depth_m, options_.mapper.keyframes);
  }

  // The map moved under the camera. The subscriber gets the frame's pose in the map as it is now.
  void moveTo(const Transform& T_w_c, FrameResult* result) {
    result->pose->T_w_c = T_w_c;
    tracker_.correct(T_w_c);
  }

  [[nodiscard]] PoseEstimate estimateOf(const PoseSolution& solution,
                                        std::span<const KnownMarker> known,
                                        const Twist& twist) const {
    PoseEstimate estimate;
    estimate.twist = twist;
    estimate.T_w_c = solution.T_w_c;
    estimate.covariance = solution.covariance;
    estimate.source = PoseSource::kMarkers;
    estimate.markers_used = solution.inliers;
    estimate.reprojection_rms_px = solution.rms_px;
    estimate.ambiguity_ratio = poseAmbiguity(solution, known, camera_.focalLength(),
                                             options_.tracking.relocalisation.square);
    return estimate;
  }

  Options options_;
  CameraModel camera_;
  MarkerDetector detector_;
  Initialiser initialiser_;
  Tracker tracker_;
  Mapper mapper_;
  LoopDetector loop_detector_;
  MarkerWatch watch_;
  double readout_s_;            // of the camera, as given or learned
  int next_readout_keyframes_;  // it is estimated again when the map has so many keyframes
  Map map_;
  KeyframeId last_old_keyframe_;  // of the map given at the start; -1 for none
  Counters counters_;
  int frames_to_next_attempt_ = 0;  // to close a loop, after one was refused
  int contradicting_marker_ = -1;   // the only marker of that loop; -1 for none
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
void Slam::optimiseGlobally() { impl_->optimiseMapGlobally(); }
void Slam::optimiseGloballyWithIntrinsics() { impl_->optimiseMapAndLens(); }

std::optional<PoseEstimate> Slam::localize(std::span<const MarkerDetection> detections,
                                           const Transform& guess_T_w_c,
                                           const Vector6d& guess_twist) const {
  return impl_->localize(detections, guess_T_w_c, guess_twist);
}

double Slam::readout_s() const { return impl_->readout_s(); }

}  // namespace waymark::slam
