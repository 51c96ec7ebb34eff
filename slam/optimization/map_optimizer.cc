#include "slam/optimization/map_optimizer.h"

#include <utility>

namespace waymark::slam {
namespace {

MapCorrection optimizeAtOnce(Map* map, SubproblemMembers roles, const MarkerOptions& markers,
                             const BundleOptions& options) {
  MapCorrection correction = runToCompletion([&](Budget* budget) {
    return optimizeSubproblem(*map, std::move(roles), markers, options, budget);
  });
  (void)apply(correction, map);
  return correction;
}

// One marker, and the keyframes that see it, held.
BundleProblem problemOfMarker(const Map& map, int marker_id, const Transform& T_w_m) {
  BundleProblem problem;
  problem.markers = {{T_w_m, false}};
  problem.marker_sizes_m = {map.markers().at(marker_id).size_m};
  for (const KeyframeId id : map.viewsOf(marker_id)) {
    const Keyframe& keyframe = map.keyframes().at(id);
    const int camera = static_cast<int>(problem.cameras.size());
    problem.cameras.push_back({keyframe.T_w_c, true});
    problem.observations.push_back({camera, 0, keyframe.find(marker_id)});
  }
  return problem;
}

}  // namespace

Task<MapCorrection> optimizeSubproblem(const Map& map, SubproblemMembers roles,
                                       const MarkerOptions& markers, BundleOptions options,
                                       Budget* budget) {
  Subproblem part = co_await buildSubproblem(map, std::move(roles), markers, budget);
  BundleAdjuster adjuster(std::move(part.problem), options);
  (void)co_await adjuster.run(budget);
  MapCorrection correction = co_await correctionOf(part, adjuster, budget);
  co_return correction;
}

std::optional<Transform> applyWhole(const MapCorrection& correction, Map* map) {
  if (correction.keyframes.empty()) return std::nullopt;
  auto T_new_old = applyAround(correction.keyframes.back().id, correction, map);
  if (T_new_old) map->beginEpoch();
  return T_new_old;
}

BundleSummary optimizeLocally(Map* map, KeyframeId keyframe, const MarkerOptions& markers,
                              const BundleOptions& options) {
  return optimizeAtOnce(map, localMap(*map, keyframe), markers, options).summary;
}

BundleSummary optimizeGlobally(Map* map, const MarkerOptions& markers,
                               const BundleOptions& options) {
  const MapCorrection correction = optimizeAtOnce(map, wholeMap(*map), markers, options);
  removeOutliers(correction, map);
  return correction.summary;
}

std::optional<Transform> optimizeMarker(const Map& map, int marker_id,
                                        const BundleOptions& options) {
  BundleOptions alone = options;
  alone.estimate_residual_sigma = false;  // of so few views it says nothing
  alone.view_chi2 = 0.0;
  BundleProblem problem = problemOfMarker(map, marker_id, *map.findPosed(marker_id)->T_w_m);
  const BundleSummary summary = adjustBundle(&problem, alone);
  return summary.failed ? std::nullopt : std::optional(problem.markers[0].T);
}

Matrix6d markerCovariance(const Map& map, int marker_id, const Transform& T_w_m,
                          double residual_sigma) {
  const BundleProblem problem = problemOfMarker(map, marker_id, T_w_m);
  constexpr double kNoKernel = 1e9;  // beyond any residual
  NormalEquations equations;
  const auto whitened = runToCompletion([&](Budget* a) { return whitenViews(problem, a); });
  const bool seen = runToCompletion(
      [&](Budget* a) { return linearize(problem, whitened, kNoKernel, &equations, a); });
  return seen ? poseCovariance(equations.H_marker[0], residual_sigma) : Matrix6d(Matrix6d::Zero());
}

}  // namespace waymark::slam
