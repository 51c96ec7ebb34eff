#include "slam/tracking/frame_tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "slam/tracking/readout_motion.h"

namespace waymark::slam {

FrameMarkers FrameTracker::split(const Map& map, std::span<const MarkerDetection> usable,
                                 const FrameTime& time, const std::optional<Prediction>& prediction,
                                 const LocalMarkers& local) {
  detections_.assign(usable.begin(), usable.end());
  if (prediction) {
    rolling_shutter_.deskew(camera_, map, prediction->T_w_c, prediction->twist, &detections_);
  }
  findKnownMarkers(map, detections_, &known_);
  local.split(known_, &split_);
  if (split_.eligible.empty()) std::swap(split_.eligible, split_.loop);
  return {time, detections_, known_, split_.eligible, split_.loop};
}

TrackingOutcome FrameTracker::track(const Map& map, const FrameMarkers& markers,
                                    const std::optional<Prediction>& prediction) {
  TrackingOutcome outcome;
  if (markers.eligible.empty()) {
    outcome.reason =
        markers.detections.empty() ? NoPoseReason::kNoMarker : NoPoseReason::kNoKnownMarker;
    outcome.lost_place = true;
    return outcome;
  }
  std::span<const KnownMarker> eligible = markers.eligible;
  std::span<const KnownMarker> loop = markers.loop;
  std::optional<PoseOfTwo> single;
  auto tracked = eligible.size() == 1
                     ? trackSingle(eligible.front(), markers.time.monotonic_ns, prediction, &single)
                     : tracker_.track(eligible, prediction);
  if (eligible.size() > 1) judge_.forget();
  if (!tracked && !loop.empty()) {
    // Lost for what is near; but the map knows other markers in view.
    outcome.lost_place = true;
    eligible = markers.known;
    loop = {};
    single.reset();
    tracked = tracker_.track(eligible, prediction);
  }
  if (!tracked) {
    outcome.rejected_poses = 1;
    outcome.reason =
        eligible.size() == 1 ? NoPoseReason::kAmbiguousMarker : NoPoseReason::kMarkersDoNotFit;
    outcome.lost_place = true;
    return outcome;
  }
  outcome.rejected_poses = tracked->prediction_rejected ? 1 : 0;
  const std::int64_t now_ns = markers.time.monotonic_ns;
  TrackedFrame& frame = outcome.frame.emplace();
  frame.time = markers.time;
  frame.method = tracked->method;
  frame.single = single;
  certain_ = isCertain(frame);
  frame.eligible = eligible;
  frame.loop = loop;
  frame.solution = std::move(tracked->solution);
  frame.twist = tracker_.twistTo(frame.solution.T_w_c, now_ns);
  deskewAgain(map, &frame);
  residual_variance_.add(frame.solution.chi2, frame.solution.degreesOfFreedom());
  frame.solution.widenTo(residual_variance_.value());
  return outcome;
}

// Of the only marker's two poses the one that the frames so far speak for. As long as they say too
// little, the one that goes on as the camera moved; without such a one there is a pose only where
// the two are hardly apart.
std::optional<TrackedPose> FrameTracker::trackSingle(const KnownMarker& marker,
                                                     std::int64_t time_ns,
                                                     const std::optional<Prediction>& prediction,
                                                     std::optional<PoseOfTwo>* single) {
  const auto expected =
      prediction && certain_ ? std::optional(prediction->T_w_c) : std::optional<Transform>();
  *single = judge_.judge(marker, time_ns, expected);
  if (!*single) return std::nullopt;
  const bool by_motion = !(*single)->decided && prediction;
  const Transform& start = by_motion ? prediction->T_w_c : (*single)->T_w_c;
  auto solution = tracker_.optimizer().optimize({&marker, 1}, start);
  if (!solution || !tracker_.optimizer().acceptable(*solution)) return std::nullopt;
  *single = (*single)->at(solution->T_w_c);
  if (!(*single)->decided) {
    const Matrix6d covariance =
        solution->covariance + coverOfOtherPose(**single, solution->covariance);
    const double sigma_rad = std::sqrt(covariance.bottomRightCorner<3, 3>().trace());
    (*single)->covered = sigma_rad <= options_.single_marker.max_undecided_sigma_rad;
    if (!by_motion && !(*single)->covered) return std::nullopt;
  }
  TrackedPose tracked;
  const bool goes_on = prediction && rotationDistance(solution->T_w_c.R, prediction->T_w_c.R) <
                                         options_.relocalization.other_rotation_rad;
  tracked.method = goes_on ? TrackingMethod::kPredicted : TrackingMethod::kRelocalized;
  tracked.prediction_rejected = prediction && !goes_on;
  tracked.solution = std::move(*solution);
  return tracked;
}

PoseEstimate FrameTracker::estimateOf(const TrackedFrame& frame) const {
  PoseEstimate estimate = tracker_.estimateOf(frame.solution, frame.eligible, frame.twist);
  const Matrix6d cover = coverOf(frame);
  estimate.covariance += cover;
  estimate.view_covariance += cover;
  if (!frame.single) return estimate;
  estimate.ambiguity_ratio =
      ambiguityOf(*frame.single, estimate.ambiguity_ratio, options_.relocalization.ambiguity_ratio,
                  options_.single_marker.min_log_odds);
  return estimate;
}

// With the velocity this frame has shown, instead of the predicted one: first as its pose tells it,
// then as its rows do, too.
void FrameTracker::deskewAgain(const Map& map, TrackedFrame* frame) {
  const double readout_s = rolling_shutter_.seconds();
  if (readout_s == 0.0) return;
  const std::int64_t now_ns = frame->time.monotonic_ns;
  const Twist used = frame->twist;
  if (!optimizeDeskewed(map, used, frame)) return;
  const auto motion = estimateReadoutMotion(
      frame->solution, frame->eligible, {camera_, readout_s, used},
      {tracker_.twistTo(frame->solution.T_w_c, now_ns), tracker_.twistCovariance(now_ns)});
  if (motion && optimizeDeskewed(map, motion->twist, frame)) frame->of_readout = motion->of_pose;
  frame->twist = tracker_.twistTo(frame->solution.T_w_c, now_ns);
}

bool FrameTracker::optimizeDeskewed(const Map& map, const Twist& twist, TrackedFrame* frame) {
  rolling_shutter_.deskew(camera_, map, frame->solution.T_w_c, twist, &detections_);
  auto better = tracker_.optimizer().optimize(frame->eligible, frame->solution.T_w_c);
  if (!better || !tracker_.optimizer().acceptable(*better)) return false;
  frame->solution = std::move(*better);
  return true;
}

FittedMarkers FrameTracker::fit(const Map& map, const FrameMarkers& markers,
                                const TrackedFrame& frame, double residual_sigma) {
  fitting_.clear();
  verdicts_.clear();
  int rejected = 0;
  for (const MarkerDetection& detection : markers.detections) {
    if (map.findPosed(detection.id) == nullptr) fitting_.push_back(detection);
  }
  const bool others_agree = frame.solution.inliers >= options_.min_witnesses;
  for (std::size_t i = 0; i < frame.eligible.size(); ++i) {
    const KnownMarker& known = frame.eligible[i];
    if (frame.solution.inlier[i]) {
      fitting_.push_back(*known.detection);
    } else {
      ++rejected;
    }
    // A frame may be stricter than the map is sure of itself.
    const bool agrees = frame.solution.inlier[i] ||
                        tracker_.optimizer().explains(known, frame.solution.T_w_c, residual_sigma);
    // What does not fit a doubted corner may be the shutter.
    const bool tells = others_agree && !known.detection->isDoubted();
    if (agrees || tells) verdicts_.push_back({known.detection->id, agrees});
  }
  sortById(&fitting_);
  return {fitting_, verdicts_, rejected};
}

}  // namespace waymark::slam
