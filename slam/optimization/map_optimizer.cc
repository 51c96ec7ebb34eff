#include "slam/optimization/map_optimizer.h"

#include <span>
#include <utility>

#include "slam/option_checks.h"
#include "slam/rolling_shutter/rolling_shutter.h"

namespace waymark::slam {
namespace {

// The readout time as an unknown: where the corners would have moved with another one.
void freeReadout(const Map& map, double readout_s, const CameraModel& camera, Subproblem* part) {
  BundleProblem& problem = part->problem;
  BundleProblem::Shutter shutter;
  shutter.readout_s = shutter.corrected_with_s = readout_s;
  for (const auto& observation : problem.observations) {
    const auto c = static_cast<std::size_t>(observation.camera);
    const auto m = static_cast<std::size_t>(observation.marker);
    const auto keyframe = map.keyframes().find(part->keyframes[c]);
    const Vector6d twist =
        keyframe != map.keyframes().end() ? keyframe->second.twist : Vector6d(Vector6d::Zero());
    const Transform T_c_w = problem.cameras[c].T.inverse();
    const auto corners = markerCorners(problem.marker_sizes_m[m]);
    auto& motion = shutter.motion.emplace_back();
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d p_c = T_c_w * (problem.markers[m].T * corners[k]);
      motion[k] = rowTime(observation.detection->pixels[k].y(), camera.height()) *
                  imageVelocity(p_c, twist);
    }
  }
  problem.shutter = std::move(shutter);
}

void removeViews(std::span<const MapCorrection::View> views, Map* map) {
  for (const auto& [keyframe, marker] : views) map->removeViews(marker, {&keyframe, 1});
}

MapCorrection optimizeAtOnce(Map* map, SubproblemMembers roles, const MarkerOptions& markers,
                             const BundleOptions& options) {
  MapCorrection correction = runToCompletion([&](Budget* budget) {
    return optimizeSubproblem(*map, std::move(roles), markers, options, budget);
  });
  (void)apply(correction, map);
  return correction;
}

}  // namespace

std::string IntrinsicPriors::invalidReason() const {
  return firstUnmet(
      {{isNotNegative(focal_px) && isNotNegative(centre_px) && isNotNegative(distortion),
        "the sigmas of the intrinsics must not be negative"}});
}

IntrinsicVector IntrinsicPriors::sigmas() const {
  IntrinsicVector sigmas;
  sigmas << focal_px, focal_px, centre_px, centre_px, distortion, distortion, distortion,
      distortion, distortion;
  return sigmas;
}

Task<MapCorrection> optimizeSubproblem(const Map& map, SubproblemMembers roles,
                                       const MarkerOptions& markers, BundleOptions options,
                                       Budget* budget) {
  Subproblem part = co_await buildSubproblem(map, std::move(roles), markers, budget);
  BundleAdjuster adjuster(std::move(part.problem), options);
  (void)co_await adjuster.run(budget);
  co_return correctionOf(part, adjuster);
}

BundleSummary optimizeLocally(Map* map, KeyframeId keyframe, const MarkerOptions& markers,
                              const BundleOptions& options) {
  return optimizeAtOnce(map, localMap(*map, keyframe), markers, options).summary;
}

BundleSummary optimizeGlobally(Map* map, const MarkerOptions& markers,
                               const BundleOptions& options) {
  const MapCorrection correction = optimizeAtOnce(map, wholeMap(*map), markers, options);
  removeViews(correction.outliers, map);
  return correction.summary;
}

BundleSummary optimizeGloballyWithIntrinsics(Map* map, const MarkerOptions& markers,
                                             const IntrinsicVector& expected,
                                             const IntrinsicPriors& priors, double readout_s,
                                             const BundleOptions& options, CameraModel* camera) {
  Subproblem part =
      runToCompletion([&](Budget* a) { return buildSubproblem(*map, wholeMap(*map), markers, a); });
  part.problem.lens = {*camera, *camera, expected, priors.sigmas()};
  BundleAdjuster adjuster(std::move(part.problem), options);
  const BundleSummary summary = runToCompletion([&](Budget* a) { return adjuster.run(a); });
  const MapCorrection correction = correctionOf(part, adjuster);
  (void)apply(correction, map);
  removeViews(correction.outliers, map);
  if (summary.failed) return summary;
  *camera = adjuster.problem().lens->camera;
  map->undistortAgain(*camera, readout_s);
  return summary;
}

Task<std::optional<ReadoutEstimate>> estimateReadout(const Map& map, const MarkerOptions& markers,
                                                     double readout_s, const CameraModel& camera,
                                                     int keyframes, BundleOptions options,
                                                     Budget* budget) {
  Subproblem newest = co_await buildSubproblem(map, newestMap(map, keyframes), markers, budget);
  freeReadout(map, readout_s, camera, &newest);
  BundleAdjuster adjuster(std::move(newest.problem), options);
  const BundleSummary summary = co_await adjuster.run(budget);
  const std::optional<double> sigma_s = co_await adjuster.readoutSigma_s(budget);
  if (summary.failed || !sigma_s) co_return std::nullopt;
  co_return ReadoutEstimate{adjuster.problem().shutter->readout_s, *sigma_s};
}

Matrix6d markerCovariance(const Map& map, int marker_id, double residual_sigma) {
  BundleProblem problem;
  const MapMarker& marker = *map.findPosed(marker_id);
  problem.markers = {{*marker.T_w_m, false}};
  problem.marker_sizes_m = {marker.size_m};
  for (const KeyframeId id : map.viewsOf(marker_id)) {
    const Keyframe& keyframe = map.keyframes().at(id);
    const int camera = static_cast<int>(problem.cameras.size());
    problem.cameras.push_back({keyframe.T_w_c, true});
    problem.observations.push_back({camera, 0, keyframe.find(marker_id)});
  }
  constexpr double kNoKernel = 1e9;
  NormalEquations equations;
  const auto whitened = runToCompletion([&](Budget* a) { return whitenCorners(problem, a); });
  const bool seen = runToCompletion(
      [&](Budget* a) { return linearize(problem, whitened, kNoKernel, &equations, a); });
  return seen ? poseCovariance(equations.H_marker[0], residual_sigma) : Matrix6d(Matrix6d::Zero());
}

}  // namespace waymark::slam
