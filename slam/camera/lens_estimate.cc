#include "slam/camera/lens_estimate.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>

#include "slam/camera/lens_model.h"
#include "slam/camera/readout_estimate.h"
#include "slam/optimization/normal_equations.h"

namespace waymark::slam {
namespace {

// Nobody is left out while the lens is wrong: the views that speak loudest of it fit worst.
BundleOptions ungated(BundleOptions options) {
  options.view_chi2 = 0.0;
  return options;
}

void freeLens(const LensProblem& lens, BundleProblem* problem) {
  problem->lens = {lens.in_use, lens.in_use, lens.expected.intrinsics(),
                   lens.prior.sigmas(lens.expected), lens.prior.aspect_share};
}

int keyframesSince(const Map& map, std::int64_t since_ns) {
  return static_cast<int>(std::ranges::count_if(
      map.keyframes(), [&](const auto& entry) { return entry.second.monotonic_ns >= since_ns; }));
}

// And the cameras find their places among them.
void holdMarkers(BundleProblem* problem) {
  for (BundleProblem::Pose& marker : problem->markers) marker.fixed = true;
  for (BundleProblem::Pose& camera : problem->cameras) camera.fixed = false;
}

void holdLens(const LensProblem& lens, BundleProblem* problem) {
  problem->lens->expected = lens.in_use.intrinsics();
  problem->lens->sigma.setZero();
}

// As seen from the first camera.
void freeMarkers(BundleProblem* problem) {
  for (BundleProblem::Pose& marker : problem->markers) marker.fixed = false;
  problem->cameras.front().fixed = true;
}

// Root mean square of the corners' distances from where they were seen, a shutter's skew taken off,
// pixels.
double rmsPx(const BundleProblem& problem) {
  const double longer_s =
      problem.shutter ? problem.shutter->readout_s - problem.shutter->corrected_with_s : 0.0;
  double sum = 0.0;
  std::size_t corners = 0;
  for (std::size_t o = 0; o < problem.observations.size(); ++o) {
    const auto& observation = problem.observations[o];
    const auto m = static_cast<std::size_t>(observation.marker);
    const Transform T_c_m =
        problem.cameras[static_cast<std::size_t>(observation.camera)].T.inverse() *
        problem.markers[m].T;
    const auto points = markerCorners(problem.marker_sizes_m[m]);
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d p = T_c_m * points[k];
      Eigen::Vector2d seen = observation.detection->normalized[k];
      if (problem.shutter) seen -= longer_s * problem.shutter->motion[o][k];
      sum += (problem.lens->camera.distort(p.head<2>() / p.z()) -
              problem.lens->seen_with.distort(seen))
                 .squaredNorm();
      ++corners;
    }
  }
  return corners > 0 ? std::sqrt(sum / static_cast<double>(corners)) : 0.0;
}

// How well a lens explains the corners, in units of the noise; more than any where it does not see
// them.
Task<double> costOf(const BundleProblem& problem, double huber, Budget* budget) {
  const std::vector<WhitenedView> whitened = co_await whitenViews(problem, budget);
  double cost = 0.0;
  const bool seen = co_await robustCost(problem, whitened, huber, &cost, budget);
  co_return seen ? cost : std::numeric_limits<double>::infinity();
}

// With the markers free, through the lens in use and through another one: what the second fits
// better. Nothing where there is no optimum.
Task<double> chi2BeyondBend(BundleProblem problem, const LensProblem& lens, BundleOptions options,
                            Budget* budget) {
  freeMarkers(&problem);
  BundleProblem held = problem;
  holdLens(lens, &held);
  BundleAdjuster bent(std::move(held), options);
  const BundleSummary of_bent = co_await bent.run(budget);
  BundleProblem freed = bent.problem();
  freed.lens = problem.lens;
  BundleAdjuster both(std::move(freed), options);
  const BundleSummary of_both = co_await both.run(budget);
  if (of_bent.failed || of_both.failed) co_return 0.0;
  const double sigma = of_both.residual_sigma;
  const double bent_cost = co_await costOf(bent.problem(), options.huber * sigma, budget);
  const double both_cost = co_await costOf(both.problem(), options.huber * sigma, budget);
  co_return (bent_cost - both_cost) / (sigma * sigma);
}

// The same lens in the other model's terms, expected where the other model has what was expected.
// Empty where there is none.
std::optional<BundleProblem> inOtherModel(const LensProblem& lens, const BundleProblem& problem) {
  const DistortionModel other =
      problem.lens->camera.calibration().model == DistortionModel::kRational
          ? DistortionModel::kEquidistant
          : DistortionModel::kRational;
  const auto camera = inModel(other, problem.lens->camera);
  const auto expected = inModel(other, lens.expected);
  if (!camera || !expected) return std::nullopt;
  BundleProblem result = problem;
  result.lens = {*camera, lens.in_use, expected->intrinsics(), lens.prior.sigmas(*expected),
                 lens.prior.aspect_share};
  return result;
}

}  // namespace

Task<std::optional<LensEstimate>> estimateLens(const Map& map, const MarkerOptions& markers,
                                               LensProblem lens, BundleOptions options,
                                               Budget* budget) {
  lens.expected = asLens(lens.expected, lens.in_use);
  const int of_this_lens = keyframesSince(map, lens.since_ns);
  const int all = static_cast<int>(map.keyframes().size());
  const bool whole = of_this_lens == all && all <= lens.max_keyframes;
  SubproblemMembers members =
      whole ? wholeMap(map) : newestMap(map, std::min(of_this_lens, lens.max_keyframes));
  Subproblem part = co_await buildSubproblem(map, std::move(members), markers, budget);
  if (lens.markers_held) holdMarkers(&part.problem);
  if (!lens.readout_known) freeReadout(map, lens.readout_s, lens.in_use, &part);
  freeLens(lens, &part.problem);
  // What another readout time explains as well is not the lens': so the one in use is tried with
  // that, too, where nobody knows it.
  double before_px = rmsPx(part.problem);
  if (!lens.readout_known) {
    BundleProblem in_use = part.problem;
    holdLens(lens, &in_use);
    BundleAdjuster held(std::move(in_use), ungated(options));
    const BundleSummary of_held = co_await held.run(budget);
    if (!of_held.failed) before_px = rmsPx(held.problem());
  }
  double chi2_beyond_bend = std::numeric_limits<double>::infinity();
  if (lens.perhaps_bent && !part.problem.cameras.empty()) {
    chi2_beyond_bend = co_await chi2BeyondBend(part.problem, lens, ungated(options), budget);
  }
  BundleAdjuster roughly(std::move(part.problem), ungated(options));
  const BundleSummary rough = co_await roughly.run(budget);
  if (rough.failed) co_return std::nullopt;
  // Again with the noise as it is through the better lens.
  BundleAdjuster adjuster(roughly.problem(), options);
  BundleSummary summary = co_await adjuster.run(budget);
  if (lens.any_model && !summary.failed) {
    // By more than chance: twice the log of likelihoods, in units of the noise.
    constexpr double kEvidence = 20.0;
    std::optional<BundleProblem> other_problem = inOtherModel(lens, adjuster.problem());
    if (other_problem) {
      BundleAdjuster other(std::move(*other_problem), options);
      const BundleSummary of_other = co_await other.run(budget);
      const double sigma = summary.residual_sigma;
      const double cost = co_await costOf(adjuster.problem(), options.huber * sigma, budget);
      const double other_cost = co_await costOf(other.problem(), options.huber * sigma, budget);
      if (!of_other.failed && other_cost + kEvidence * sigma * sigma < cost) {
        adjuster = std::move(other);
        summary = of_other;
      }
    }
  }
  const auto covariance = co_await adjuster.globalsCovariance(budget);
  if (summary.failed || !covariance) co_return std::nullopt;
  MapCorrection correction = co_await correctionOf(part, adjuster, budget);
  std::optional<LensEstimate> estimate({.camera = adjuster.problem().lens->camera,
                                        .covariance = covariance->topLeftCorner<9, 9>(),
                                        .correction = std::move(correction),
                                        .of_whole_map = whole,
                                        .rms_before_px = before_px,
                                        .rms_after_px = rmsPx(adjuster.problem()),
                                        .chi2_beyond_bend = chi2_beyond_bend});
  co_return estimate;
}

double lensChange(const LensEstimate& estimate, const CameraModel& in_use) {
  if (estimate.camera.calibration().model != in_use.calibration().model) {
    return std::numeric_limits<double>::infinity();
  }
  const IntrinsicVector difference = estimate.camera.intrinsics() - in_use.intrinsics();
  return difference.dot(estimate.covariance.ldlt().solve(difference));
}

}  // namespace waymark::slam
