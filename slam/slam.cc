#include "slam/slam.h"

#include <algorithm>
#include <utility>

#include "slam/geometry/robust.h"
#include "slam/initialisation/one_frame.h"
#include "slam/keyframes/keyframe_policy.h"
#include "slam/marker_pose/marker_resolver.h"
#include "slam/optimisation/map_optimiser.h"
#include "slam/relocalisation/relocaliser.h"
#include "slam/tracking/motion_model.h"
#include "slam/tracking/pose_optimiser.h"

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

double imageArea(const MarkerDetection& d) {
  const Eigen::Vector2d a = d.normalised[2] - d.normalised[0];
  const Eigen::Vector2d b = d.normalised[3] - d.normalised[1];
  return std::abs(a.x() * b.y() - a.y() * b.x());
}

}  // namespace

class Slam::Impl {
 public:
  Impl(const CameraModel& camera, Dictionary dictionary, const Options& options)
      : options_(options),
        camera_(camera),
        detector_(camera_, std::move(dictionary), options.detector),
        optimiser_(camera_.focalLength(), options.tracking),
        motion_(options.motion) {
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

  FrameResult processDetections(std::span<const MarkerDetection> detections, const FrameTime& time,
                                StageObserver* observer) {
    ++counters_.frames;
    FrameResult result;
    if (map_.empty()) {
      const StageScope scope(observer, Stage::kMap);
      result = initialise(detections, time);
    } else {
      std::vector<MarkerDetection> fitting;
      {
        const StageScope scope(observer, Stage::kTrack);
        result = track(detections, time, &fitting);
      }
      if (result.pose) {
        const StageScope scope(observer, Stage::kMap);
        updateMap(fitting, time, &result);
      }
    }
    if (result.pose) ++counters_.localized;
    result.detections = detections;
    return result;
  }

  void optimiseMapGlobally() { (void)slam::optimiseGlobally(&map_, options_.global_optimisation); }

  [[nodiscard]] std::optional<PoseEstimate> localize(std::span<const MarkerDetection> detections,
                                                     const Transform& guess) const {
    const std::vector<KnownMarker> known = knownMarkers(detections);
    const auto solution = optimiser_.optimise(observationsOf(known), guess);
    if (!solution || !optimiser_.acceptable(*solution)) return std::nullopt;
    return estimateOf(*solution, known);
  }

  [[nodiscard]] const Map& map() const { return map_; }
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const CameraModel& camera() const { return camera_; }

 private:
  // Section 4.1: the first frame with an unambiguous marker is the world's origin.
  FrameResult initialise(std::span<const MarkerDetection> detections, const FrameTime& time) {
    FrameResult result;
    result.state = TrackingState::kInitializing;
    const auto initial = initialiseFromOneFrame(detections, options_.marker_size_m,
                                                camera_.focalLength(), options_.initialisation);
    if (initial.empty()) {
      result.reason =
          detections.empty() ? "no marker in view" : "all markers in view are ambiguous";
      return result;
    }
    for (const MarkerDetection& detection : detections) {
      map_.markers[detection.id] = {detection.id, options_.marker_size_m, std::nullopt};
    }
    for (const InitialMarker& marker : initial) map_.markers[marker.id].T_w_m = marker.T_c_m;
    insertKeyframe(detections, Transform{}, time);

    const std::vector<KnownMarker> known = knownMarkers(detections);
    const auto solution = optimiser_.optimise(observationsOf(known), Transform{});
    if (solution) {
      result.pose = estimateOf(*solution, known);
      result.pose->T_w_c = Transform{};  // by definition of the world
      result.state = TrackingState::kTracking;
    }
    result.map_changed = result.keyframe_added = true;
    motion_.update(Transform{}, time.monotonic_ns);
    return result;
  }

  // Sections 4.3 and 4.8: from the predicted pose if there is one, else from the markers alone.
  // `fitting` gets the detections that agree with the pose, and those the map does not know yet.
  FrameResult track(std::span<const MarkerDetection> detections, const FrameTime& time,
                    std::vector<MarkerDetection>* fitting) {
    FrameResult result;
    result.state = TrackingState::kRelocalizing;
    const std::vector<KnownMarker> known = knownMarkers(detections);
    if (known.empty()) {
      result.reason = detections.empty() ? "no marker in view" : "no marker in view has a pose yet";
      return result;
    }
    std::optional<PoseSolution> solution;
    if (const auto predicted = motion_.predict(time.monotonic_ns)) {
      solution = optimiser_.optimise(observationsOf(known), *predicted);
      if (solution && !optimiser_.acceptable(*solution)) {
        ++counters_.rejected_poses;
        solution.reset();
      }
    }
    if (!solution) {
      auto relocalisation =
          relocalise(known, optimiser_, camera_.focalLength(), options_.relocalisation);
      if (!relocalisation || !optimiser_.acceptable(relocalisation->solution)) {
        result.reason = known.size() == 1 ? "the only known marker in view is ambiguous"
                                          : "the markers in view do not fit the map";
        return result;
      }
      ++counters_.relocalizations;
      solution = std::move(relocalisation->solution);
    }

    for (const MarkerDetection& detection : detections) {
      if (map_.findPosed(detection.id) == nullptr) fitting->push_back(detection);
    }
    for (std::size_t i = 0; i < known.size(); ++i) {
      if (solution->inlier[i]) {
        fitting->push_back(*known[i].observation.detection);
      } else {
        ++counters_.rejected_markers;
      }
    }
    std::sort(fitting->begin(), fitting->end(),
              [](const MarkerDetection& a, const MarkerDetection& b) { return a.id < b.id; });
    result.pose = estimateOf(*solution, known);
    result.state = TrackingState::kTracking;
    motion_.update(solution->T_w_c, time.monotonic_ns);
    return result;
  }

  // Sections 4.4 to 4.7: keyframe, new markers, ambiguous markers, culling, local optimisation.
  void updateMap(std::span<const MarkerDetection> detections, const FrameTime& time,
                 FrameResult* result) {
    const Transform& T_w_c = result->pose->T_w_c;
    std::vector<InitialMarker> unambiguous;
    for (const MarkerDetection& detection : detections) {
      if (map_.findPosed(detection.id) != nullptr) continue;
      const auto pose = estimateSquarePose(detection, options_.marker_size_m, camera_.focalLength(),
                                           options_.marker_pose.square);
      if (pose && pose->unambiguous(options_.marker_pose.ambiguity_ratio)) {
        unambiguous.push_back({detection.id, pose->T_c_m[0]});
      }
    }
    const KeyframeReason reason =
        keyframeReason(map_, detections, T_w_c, medianDepth(detections, T_w_c),
                       !unambiguous.empty(), options_.keyframes);
    if (reason == KeyframeReason::kNone) return;

    insertKeyframe(detections, T_w_c, time);
    for (const MarkerDetection& detection : detections) {
      map_.markers.try_emplace(detection.id,
                               MapMarker{detection.id, options_.marker_size_m, std::nullopt});
    }
    for (const InitialMarker& marker : unambiguous) {
      map_.markers[marker.id].T_w_m = T_w_c * marker.T_c_m;  // Eq. 23
    }
    resolveAmbiguousMarkers(detections);
    (void)optimiseLocally(&map_, map_.keyframes.size() - 1, options_.local_optimisation);
    motion_.correct(map_.keyframes.back().T_w_c);
    (void)cullKeyframes(&map_, options_.keyframes);
    result->map_changed = result->keyframe_added = true;
  }

  void resolveAmbiguousMarkers(std::span<const MarkerDetection> detections) {
    for (const MarkerDetection& detection : detections) {
      MapMarker& marker = map_.markers.at(detection.id);
      if (marker.T_w_m) continue;
      std::vector<MarkerView> views;
      for (const Keyframe& keyframe : map_.keyframes) {
        if (const MarkerDetection* seen = keyframe.find(marker.id)) {
          views.push_back({seen, keyframe.T_w_c});
        }
      }
      marker.T_w_m =
          resolveMarkerPose(views, marker.size_m, camera_.focalLength(), options_.marker_pose);
    }
  }

  void insertKeyframe(std::span<const MarkerDetection> detections, const Transform& T_w_c,
                      const FrameTime& time) {
    map_.keyframes.push_back({map_.next_keyframe_index++,
                              time.sequence,
                              time.monotonic_ns,
                              T_w_c,
                              {detections.begin(), detections.end()}});
    ++counters_.keyframes_added;
  }

  [[nodiscard]] std::vector<KnownMarker> knownMarkers(
      std::span<const MarkerDetection> detections) const {
    std::vector<KnownMarker> known;
    known.reserve(detections.size());
    for (const MarkerDetection& detection : detections) {
      const MapMarker* marker = map_.findPosed(detection.id);
      if (marker == nullptr) continue;
      known.push_back({{&detection, marker->cornersInWorld()}, *marker->T_w_m, marker->size_m});
    }
    return known;
  }

  [[nodiscard]] static std::vector<PoseObservation> observationsOf(
      std::span<const KnownMarker> known) {
    std::vector<PoseObservation> observations;
    observations.reserve(known.size());
    for (const KnownMarker& marker : known) observations.push_back(marker.observation);
    return observations;
  }

  [[nodiscard]] PoseEstimate estimateOf(const PoseSolution& solution,
                                        std::span<const KnownMarker> known) const {
    PoseEstimate estimate;
    estimate.T_w_c = solution.T_w_c;
    estimate.covariance = solution.covariance;
    estimate.source = PoseSource::kMarkers;
    estimate.markers_used = solution.inliers;
    estimate.reprojection_rms_px = solution.rms_px;
    estimate.ambiguity_ratio = ambiguityOf(solution, known);
    return estimate;
  }

  // How much worse the other solution of the largest marker explains all of them.
  [[nodiscard]] double ambiguityOf(const PoseSolution& solution,
                                   std::span<const KnownMarker> known) const {
    const auto largest = std::max_element(
        known.begin(), known.end(), [](const KnownMarker& a, const KnownMarker& b) {
          return imageArea(*a.observation.detection) < imageArea(*b.observation.detection);
        });
    const auto pose = estimateSquarePose(*largest->observation.detection, largest->size_m,
                                         camera_.focalLength(), options_.relocalisation.square);
    if (!pose) return 1.0;
    if (known.size() == 1) return pose->ratio;
    const Transform T_c_m = solution.T_w_c.inverse() * largest->T_w_m;
    const std::size_t other =
        rotationDistance(T_c_m.R, pose->T_c_m[0].R) < rotationDistance(T_c_m.R, pose->T_c_m[1].R)
            ? 1
            : 0;
    const Transform T_w_c = largest->T_w_m * pose->T_c_m[other].inverse();
    double cost = 0.0;
    for (std::size_t i = 0; i < known.size(); ++i) {
      if (!solution.inlier[i]) continue;
      constexpr double kBehind = 1e6;  // chi-square of a marker the other pose cannot even see
      cost += PoseOptimiser::markerChi2(known[i].observation, T_w_c).value_or(kBehind);
    }
    return (cost + 1.0) / (solution.chi2 + 1.0);
  }

  [[nodiscard]] double medianDepth(std::span<const MarkerDetection> detections,
                                   const Transform& T_w_c) const {
    std::vector<double> depths;
    for (const MarkerDetection& detection : detections) {
      const MapMarker* marker = map_.findPosed(detection.id);
      if (marker != nullptr) depths.push_back((marker->T_w_m->p - T_w_c.p).norm());
    }
    return depths.empty() ? 0.0 : median(std::move(depths));
  }

  Options options_;
  CameraModel camera_;
  MarkerDetector detector_;
  PoseOptimiser optimiser_;
  MotionModel motion_;
  Map map_;
  Counters counters_;
};

Slam::Slam(const CameraModel& camera, Dictionary dictionary, const Options& options)
    : impl_(std::make_unique<Impl>(camera, std::move(dictionary), options)) {}
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
void Slam::optimiseGlobally() { impl_->optimiseMapGlobally(); }

std::optional<PoseEstimate> Slam::localize(std::span<const MarkerDetection> detections,
                                           const Transform& guess_T_w_c) const {
  return impl_->localize(detections, guess_T_w_c);
}

}  // namespace waymark::slam
