#include "slam/tracking/tracker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "slam/geometry/plane.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

double imageArea(const MarkerDetection& d) {
  return std::abs(cross(d.normalized[2] - d.normalized[0], d.normalized[3] - d.normalized[1]));
}

// How far a pose is from the predicted one, as the markers' depth sees it, radians.
double innovation(const Transform& T_w_c, const Transform& predicted, double depth_m) {
  return rotationDistance(T_w_c.R, predicted.R) + (T_w_c.p - predicted.p).norm() / depth_m;
}

}  // namespace

std::string TrackerOptions::invalidReason() const {
  return firstReason({
      pose.invalidReason(),
      motion.invalidReason(),
      relocalization.invalidReason(),
      single_marker.invalidReason(),
      residual_variance.invalidReason(),
      firstUnmet({
          {isNotNegative(max_innovation_per_rms),
           "the innovation of a believed marker must not be negative"},
          {min_witnesses >= 1, "a marker that disagrees needs at least 1 witness"},
          {isNotNegative(ambiguity_floor), "the floor of a pose's ambiguity must not be negative"},
      }),
  });
}

Tracker::Tracker(double focal_px, const TrackerOptions& options)
    : focal_px_(focal_px),
      options_(options),
      optimizer_(focal_px, options.pose),
      motion_(options.motion) {}

std::optional<TrackedPose> Tracker::track(std::span<const KnownMarker> markers,
                                          const std::optional<Prediction>& prediction) const {
  TrackedPose tracked;
  if (prediction) {
    if (auto solution = fromPrediction(markers, prediction->T_w_c)) {
      tracked.solution = std::move(*solution);
      return tracked;
    }
    tracked.prediction_rejected = true;
  }
  auto solution = fromMarkersAlone(markers);
  if (!solution) return std::nullopt;
  tracked.solution = std::move(*solution);
  tracked.method = TrackingMethod::kRelocalized;
  return tracked;
}

std::optional<PoseSolution> Tracker::locate(std::span<const KnownMarker> markers,
                                            const Transform& guess_T_w_c) const {
  auto near = optimizer_.optimize(markers, guess_T_w_c);
  if (near && optimizer_.acceptable(*near)) return near;
  return fromMarkersAlone(markers);  // the guess may be from before a loop was closed
}

PoseEstimate Tracker::estimateOf(const PoseSolution& solution, std::span<const KnownMarker> markers,
                                 const Vector6d& twist) const {
  PoseEstimate estimate;
  estimate.T_w_c = solution.T_w_c;
  estimate.covariance = estimate.view_covariance = solution.covariance;
  estimate.twist = twist;
  estimate.source = PoseSource::kMarkers;
  estimate.markers_used = solution.inliers;
  estimate.reprojection_rms_px = solution.rms_px;
  estimate.ambiguity_ratio = poseAmbiguity(solution, markers, focal_px_, options_);
  return estimate;
}

std::optional<PoseSolution> Tracker::fromMarkersAlone(std::span<const KnownMarker> markers) const {
  auto solution = relocalize(markers, optimizer_, focal_px_, options_.relocalization);
  if (!solution || !optimizer_.acceptable(*solution)) return std::nullopt;
  return solution;
}

std::optional<PoseSolution> Tracker::fromPrediction(std::span<const KnownMarker> markers,
                                                    const Transform& predicted) const {
  auto together = optimizer_.optimize(markers, predicted);
  if (together && optimizer_.acceptable(*together)) return together;
  if (markers.size() != 2) return std::nullopt;
  // Two markers that contradict each other: the one that goes on as the camera moved is believed.
  std::optional<PoseSolution> believed;
  double least = options_.max_innovation_per_rms * options_.pose.max_rms_px / focal_px_;  // radians
  for (std::size_t i = 0; i < 2; ++i) {
    auto alone = optimizer_.optimize(markers.subspan(i, 1), predicted);
    if (!alone || !optimizer_.acceptable(*alone)) continue;
    const double depth = (markers[i].T_w_m.p - alone->T_w_c.p).norm();
    const double how_far = innovation(alone->T_w_c, predicted, depth);
    if (how_far >= least) continue;
    least = how_far;
    alone->inlier = {i == 0, i == 1};
    believed = std::move(alone);
  }
  return believed;
}

double poseAmbiguity(const PoseSolution& solution, std::span<const KnownMarker> markers,
                     double focal_px, const TrackerOptions& options) {
  const SquarePoseOptions& square = options.relocalization.square;
  const auto largest = std::max_element(markers.begin(), markers.end(),
                                        [](const KnownMarker& a, const KnownMarker& b) {
                                          return imageArea(*a.detection) < imageArea(*b.detection);
                                        });
  if (markers.size() == 1) {
    const auto pose = estimateSquarePose(*largest->detection, largest->size_m, focal_px, square);
    return pose ? pose->ratio : 1.0;
  }
  const auto other = otherSquarePose(*largest->detection, largest->size_m,
                                     solution.T_w_c.inverse() * largest->T_w_m, square);
  if (!other) return 1.0;
  const Transform T_w_c = largest->T_w_m * other->inverse();
  double cost = 0.0;
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!solution.inlier[i]) continue;
    cost += PoseOptimizer::markerChi2(markers[i], T_w_c).value_or(square.unseen_chi2);
  }
  return (cost + options.ambiguity_floor) / (solution.chi2 + options.ambiguity_floor);
}

}  // namespace waymark::slam
