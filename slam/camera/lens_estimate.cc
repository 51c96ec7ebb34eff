#include "slam/camera/lens_estimate.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>

#include "slam/camera/lens_model.h"
#include "slam/camera/readout_estimate.h"
#include "slam/geometry/robust.h"
#include "slam/optimization/normal_equations.h"

namespace waymark::slam {
namespace {

// Beginning with that one, in whatever model it is.
void freeLens(const CameraModel& beginning, const LensProblem& lens, BundleProblem* problem) {
  const CameraModel expected = expectedAs(lens.expected, !lens.any_model, beginning);
  problem->lens = {beginning, lens.in_use, expected.intrinsics(), lens.prior.covariance(expected)};
}

int keyframesSince(const Map& map, std::int64_t since_ns) {
  return static_cast<int>(std::ranges::count_if(
      map.keyframes(), [&](const auto& entry) { return entry.second.monotonic_ns >= since_ns; }));
}

// And the cameras find their places among them.
void holdMarkers(Subproblem* part) {
  for (BundleProblem::Pose& marker : part->problem.markers) marker.fixed = true;
  for (std::size_t k = 0; k < part->keyframes.size(); ++k) part->problem.cameras[k].fixed = false;
}

// Through that one, whatever the corners say.
void holdLens(const CameraModel& held, const LensProblem& lens, BundleProblem* problem) {
  problem->lens = {held, lens.in_use, held.intrinsics(), IntrinsicMatrix::Zero()};
}

// As seen from the first camera.
void freeMarkers(BundleProblem* problem) {
  for (BundleProblem::Pose& marker : problem->markers) marker.fixed = false;
  problem->cameras.front().fixed = true;
}

// Squared distances of the corners from where they were seen, a shutter's skew taken off, pixels.
std::vector<double> squaredErrors(const BundleProblem& problem) {
  const double longer_s =
      problem.shutter ? problem.shutter->readout_s - problem.shutter->corrected_with_s : 0.0;
  std::vector<double> squared;
  squared.reserve(4 * problem.observations.size());
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
      squared.push_back((problem.lens->camera.distort(p.head<2>() / p.z()) -
                         problem.lens->seen_with.distort(seen))
                            .squaredNorm());
    }
  }
  return squared;
}

double rootMean(const std::vector<double>& squared) {
  const double sum = std::accumulate(squared.begin(), squared.end(), 0.0);
  return squared.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(squared.size()));
}

double rmsPx(const BundleProblem& problem) { return rootMean(squaredErrors(problem)); }

double rootMedian(std::vector<double> squared) {
  return squared.empty() ? 0.0 : std::sqrt(median(std::move(squared)));
}

// Without the correction.
LensComparison errorsOf(const BundleProblem& in_use, const BundleProblem& other) {
  const std::vector<double> as_is = squaredErrors(in_use);
  const std::vector<double> as_other = squaredErrors(other);
  return {.correction = {},
          .rms_in_use_px = rootMean(as_is),
          .rms_px = rootMean(as_other),
          .median_in_use_px = rootMedian(as_is),
          .median_px = rootMedian(as_other),
          .evidence = {}};
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
  holdLens(lens.in_use, lens, &held);
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

struct Settled {
  BundleAdjuster adjuster;
  double sigma = 1.0;  // of the residuals
};

// With the noise as it was told, and all views. Empty where there is no optimum.
Task<std::optional<BundleAdjuster>> settleRoughly(BundleProblem problem,
                                                  const BundleOptions& options, Budget* budget) {
  std::optional<BundleAdjuster> roughly(std::in_place, std::move(problem), ungated(options));
  const BundleSummary summary = co_await roughly->run(budget);
  if (summary.failed) co_return std::nullopt;
  co_return roughly;
}

// From there, with the noise as it is through the better lens. Empty where there is no optimum.
Task<std::optional<Settled>> settleFrom(const BundleProblem& rough, const BundleOptions& options,
                                        Budget* budget) {
  std::optional<Settled> settled({.adjuster = BundleAdjuster(rough, options)});
  const BundleSummary summary = co_await settled->adjuster.run(budget);
  if (summary.failed) co_return std::nullopt;
  settled->sigma = summary.residual_sigma;
  co_return settled;
}

// Both runs.
Task<std::optional<Settled>> settle(BundleProblem problem, const BundleOptions& options,
                                    Budget* budget) {
  const std::optional<BundleAdjuster> roughly =
      co_await settleRoughly(std::move(problem), options, budget);
  if (!roughly) co_return std::nullopt;
  std::optional<Settled> settled = co_await settleFrom(roughly->problem(), options, budget);
  co_return settled;
}

double chi2Between(const CameraModel& camera, const IntrinsicMatrix& covariance,
                   const CameraModel& other) {
  if (camera.calibration().model != other.calibration().model) {
    return std::numeric_limits<double>::infinity();
  }
  const IntrinsicVector difference = camera.intrinsics() - other.intrinsics();
  return difference.dot(covariance.ldlt().solve(difference));
}

// How far what was found from there is from the lens in use: chi-square. Infinite where nobody can
// tell.
Task<double> chi2FromLensInUse(const LensProblem& lens, const BundleProblem& before,
                               BundleAdjuster* found, Budget* budget) {
  const std::optional<GlobalMatrix> covariance = co_await found->globalsCovariance(budget);
  if (!covariance) co_return std::numeric_limits<double>::infinity();
  // It is scaled by the noise as it is through the lens in use, however wrong that is.
  const double noise =
      rootMedian(squaredErrors(found->problem())) / rootMedian(squaredErrors(before));
  co_return chi2Between(found->problem().lens->camera,
                        noise * noise * covariance->topLeftCorner<9, 9>(), lens.in_use);
}

// Whether a single step says so already, which costs a quarter of all of them.
Task<bool> agreesAtOnce(const LensProblem& lens, const BundleProblem& problem,
                        const BundleOptions& options, Budget* budget) {
  // Of the chi-square after all steps. The first one is short of what images hardly tell, focal
  // length and distances together: 0.3 to 0.8 where the calibration is right, 0.4 to 0.6 where its
  // focal length is wrong by 0.2 to 1 %.
  constexpr double kAfterOneStep = 0.5;
  BundleOptions one_step = ungated(options);
  one_step.max_iterations = 1;
  BundleAdjuster look(problem, one_step);
  const BundleSummary summary = co_await look.run(budget);
  if (!(summary.final_cost < summary.initial_cost)) co_return false;  // it leads nowhere
  const double chi2 = co_await chi2FromLensInUse(lens, problem, &look, budget);
  co_return chi2 < kAfterOneStep* lens.agrees_chi2;
}

// The first half of an estimate. Empty where there is no optimum, and where it agrees with the lens
// in use.
Task<std::optional<BundleAdjuster>> settleUnlessInUse(const LensProblem& lens,
                                                      const BundleProblem& problem,
                                                      const BundleOptions& options,
                                                      Budget* budget) {
  const bool may_agree = lens.agrees_chi2 > 0.0;
  if (may_agree) {
    const bool agrees = co_await agreesAtOnce(lens, problem, options, budget);
    if (agrees) co_return std::nullopt;
  }
  std::optional<BundleAdjuster> roughly = co_await settleRoughly(problem, options, budget);
  if (roughly && may_agree) {
    const double chi2 = co_await chi2FromLensInUse(lens, problem, &*roughly, budget);
    if (chi2 < lens.agrees_chi2) co_return std::nullopt;
  }
  co_return roughly;
}

// Through the lens in use, with the map as that has it: in as many iterations as another lens gets.
// A map that is not at its optimum fits every lens badly.
Task<std::optional<Settled>> settleThrough(const CameraModel& held, const LensProblem& lens,
                                           BundleProblem problem, const BundleOptions& options,
                                           Budget* budget) {
  holdLens(held, lens, &problem);
  std::optional<Settled> settled = co_await settle(std::move(problem), options, budget);
  co_return settled;
}

// Where else to begin from, as each beginning leads to the nearest minimum only: the lens in the
// other model's terms (the one in use, if what was found bends back within the image, where the
// other model cannot follow); and where it is not known well yet, lenses without distortion.
std::vector<CameraModel> otherBeginnings(const LensProblem& lens, const CameraModel& found) {
  const DistortionModel model = found.calibration().model;
  const DistortionModel other = model == DistortionModel::kRational ? DistortionModel::kEquidistant
                                                                    : DistortionModel::kRational;
  std::vector<CameraModel> beginnings;
  if (const auto camera = inModel(other, coversImage(found) ? found : lens.in_use)) {
    beginnings.push_back(*camera);
  }
  if (lens.any_beginning) {
    beginnings.push_back(withoutDistortion(other, found));
    beginnings.push_back(withoutDistortion(model, found));
  }
  return beginnings;
}

// What was found, or what another beginning leads to, if that is better.
Task<Settled> bestFromAnywhere(const LensProblem& lens, const BundleOptions& options, Settled best,
                               Budget* budget) {
  // By which the other model has to be better than chance: twice the log of likelihoods, in units
  // of the noise.
  constexpr double kEvidence = 20.0;
  const CameraModel found = best.adjuster.problem().lens->camera;
  const double sigma = best.sigma;
  const double huber = options.huber * sigma;
  double least = co_await costOf(best.adjuster.problem(), huber, budget);
  bool covers = coversImage(found);
  for (const CameraModel& beginning : otherBeginnings(lens, found)) {
    BundleProblem problem = best.adjuster.problem();
    freeLens(beginning, lens, &problem);
    std::optional<Settled> other = co_await settle(std::move(problem), options, budget);
    if (!other) continue;
    const CameraModel& camera = other->adjuster.problem().lens->camera;
    double cost = co_await costOf(other->adjuster.problem(), huber, budget);
    if (camera.calibration().model != found.calibration().model) cost += kEvidence * sigma * sigma;
    // A lens that does not see all of the image is no lens, however well it fits.
    const bool other_covers = coversImage(camera);
    if (other_covers == covers ? !(cost < least) : covers) continue;
    least = cost;
    covers = other_covers;
    best = std::move(*other);
  }
  co_return best;
}

}  // namespace

Task<std::optional<LensEstimate>> estimateLens(const Map& map, const MarkerOptions& markers,
                                               LensProblem lens, BundleOptions options,
                                               Budget* budget) {
  const int of_this_lens = keyframesSince(map, lens.since_ns);
  const int all = static_cast<int>(map.keyframes().size());
  const bool whole = of_this_lens == all && all <= lens.max_keyframes;
  SubproblemMembers members =
      whole ? wholeMap(map) : newestMap(map, std::min(of_this_lens, lens.max_keyframes));
  Subproblem part = co_await buildSubproblem(map, std::move(members), markers, budget);
  if (lens.markers_held) holdMarkers(&part);
  if (!lens.readout_known) freeReadout(map, lens.readout_s, lens.in_use, &part);
  freeLens(lens.in_use, lens, &part.problem);
  const std::optional<BundleAdjuster> roughly =
      co_await settleUnlessInUse(lens, part.problem, options, budget);
  if (!roughly) co_return std::nullopt;
  BundleProblem in_use = part.problem;
  holdLens(lens.in_use, lens, &in_use);
  // What another readout time explains as well is not the lens': so the one in use is tried with
  // that, too, where nobody knows it.
  if (!lens.readout_known) {
    BundleAdjuster held(in_use, ungated(options));
    const BundleSummary of_held = co_await held.run(budget);
    if (!of_held.failed) in_use = held.problem();
  }
  double before_px = rmsPx(in_use);
  double chi2_beyond_bend = std::numeric_limits<double>::infinity();
  if (lens.perhaps_bent && !part.problem.cameras.empty()) {
    chi2_beyond_bend = co_await chi2BeyondBend(part.problem, lens, ungated(options), budget);
  }
  std::optional<Settled> settled = co_await settleFrom(roughly->problem(), options, budget);
  if (!settled) co_return std::nullopt;
  const CameraModel& found = settled->adjuster.problem().lens->camera;
  const CameraModel expected = lens.prior.expectedGiven(lens.expected, found);
  if (expected.calibration() != lens.expected.calibration()) {  // it holds what was found too fast
    lens.expected = expected;
    BundleProblem problem = settled->adjuster.problem();
    freeLens(found, lens, &problem);
    settled = co_await settle(std::move(problem), options, budget);
    if (!settled) co_return std::nullopt;
  }
  if (lens.any_model)
    settled = co_await bestFromAnywhere(lens, options, std::move(*settled), budget);
  BundleAdjuster& adjuster = settled->adjuster;
  const auto covariance = co_await adjuster.globalsCovariance(budget);
  if (!covariance) co_return std::nullopt;
  const double after_px = rmsPx(adjuster.problem());
  LensEvidence evidence;
  constexpr double kMuchBetter = 0.9;  // and worth a second look
  const IntrinsicMatrix of_lens = covariance->topLeftCorner<9, 9>();
  const double chi2 = chi2Between(adjuster.problem().lens->camera, of_lens, lens.in_use);
  if (!lens.perhaps_bent && (after_px < kMuchBetter * before_px || chi2 > lens.contradicts_chi2)) {
    const std::optional<Settled> held =
        co_await settleThrough(lens.in_use, lens, std::move(in_use), options, budget);
    if (held) {
      before_px = std::min(before_px, rmsPx(held->adjuster.problem()));
      evidence = co_await lensEvidence(held->adjuster.problem(), adjuster.problem(),
                                       options.huber * settled->sigma, budget);
    }
  }
  MapCorrection correction = co_await correctionOf(part, adjuster, budget);
  std::optional<LensEstimate> estimate({.camera = adjuster.problem().lens->camera,
                                        .covariance = of_lens,
                                        .correction = std::move(correction),
                                        .of_whole_map = whole,
                                        .rms_before_px = before_px,
                                        .rms_after_px = after_px,
                                        .evidence = evidence,
                                        .chi2_beyond_bend = chi2_beyond_bend});
  co_return estimate;
}

Task<std::optional<LensComparison>> compareLens(const CameraModel& other, const Map& map,
                                                const MarkerOptions& markers, LensProblem lens,
                                                BundleOptions options, Budget* budget) {
  Subproblem part = co_await buildSubproblem(map, wholeMap(map), markers, budget);
  if (!lens.readout_known) freeReadout(map, lens.readout_s, lens.in_use, &part);
  const std::optional<Settled> in_use =
      co_await settleThrough(lens.in_use, lens, part.problem, options, budget);
  std::optional<Settled> through =
      co_await settleThrough(other, lens, part.problem, options, budget);
  if (!in_use || !through) co_return std::nullopt;
  std::optional<LensComparison> comparison =
      errorsOf(in_use->adjuster.problem(), through->adjuster.problem());
  comparison->evidence =
      co_await lensEvidence(through->adjuster.problem(), in_use->adjuster.problem(),
                            options.huber * in_use->sigma, budget);
  comparison->correction = co_await correctionOf(part, through->adjuster, budget);
  co_return comparison;
}

double lensChange(const LensEstimate& estimate, const CameraModel& in_use) {
  return chi2Between(estimate.camera, estimate.covariance, in_use);
}

}  // namespace waymark::slam
