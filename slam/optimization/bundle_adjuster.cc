#include "slam/optimization/bundle_adjuster.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/Cholesky>

#include "slam/geometry/robust.h"
#include "slam/optimization/marker_relation.h"
#include "slam/optimization/residual_sigma.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

constexpr double kHopeless = 1e10;  // damping beyond which no step will help
// Of a cost, in units of the noise squared: a large map that has so much less of it is seen to be
// another one, however small a part of its cost that is.
constexpr double kNoticeable = 1.0;

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kMovePose = 0.08;
constexpr double kCopyPose = 0.03;
constexpr double kWeighView = 0.01;
constexpr double kTestConstraint = 1.0;

// What is left of a weight that is to pull nothing: a frame that nothing else holds keeps a place.
constexpr double kLeftOut = 1e-4;

// False when the step leaves what a lens can be.
bool moveLens(const BundleProblem::Lens& from, const IntrinsicVector& step,
              BundleProblem::Lens* to) {
  const Calibration moved = from.camera.withIntrinsics(from.camera.intrinsics() + step);
  if (!moved.invalidReason().empty()) return false;
  to->camera = CameraModel(moved);
  return true;
}

// The equations are in units of the corners' noise; what is said of markers has sigmas of its own.
void weighConstraints(double factor, BundleProblem* problem) {
  for (BundleProblem::Constraint& constraint : problem->constraints) {
    for (BundleProblem::Relation& relation : constraint.relations) relation.weight *= factor;
  }
}

// How far a relation is from what all else says, in sigmas squared, were it not there: all other
// poses held. H: of the marker's pose, with the relation in it. Zero where nothing else says.
double contradiction(const BundleProblem::Relation& relation, const Transform& T_w_f,
                     const BundleProblem::Pose& marker, const Matrix6d& H, double huber) {
  const Eigen::Vector3d residual = relationResidual(relation, T_w_f, marker.T);
  if (marker.fixed) return residual.squaredNorm();
  const Eigen::Matrix<double, 3, 6> J = relationJacobian(relation, T_w_f, marker.T);
  const double weight = huberWeight(residual.squaredNorm(), huber);
  const Eigen::LLT<Matrix6d> without(H - weight * J.transpose() * J);
  if (without.info() != Eigen::Success) return 0.0;
  const Eigen::Matrix3d share = J * without.solve(J.transpose());
  // At the optimum it has pulled the marker by as much.
  const Eigen::Vector3d innovation = residual + weight * share * residual;
  const Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity() + share;
  return innovation.dot(covariance.llt().solve(innovation));
}

}  // namespace

std::string BundleOptions::invalidReason() const {
  return firstUnmet({
      {max_iterations >= 1, "an optimization needs at least 1 iteration"},
      {isNotNegative(min_relative_decrease), "the least decrease of a cost must not be negative"},
      {isPositive(huber), "Huber's threshold must be positive"},
      {isNotNegative(view_chi2), "the chi-square of gross views must not be negative"},
      {isShare(gate_after), "the iterations before the gate must be a share from 0 to 1"},
      {min_views >= 0, "the views that every pose keeps must not be negative"},
      {isShare(max_gated_share), "the share of gross views must be from 0 to 1"},
  });
}

Task<BundleSummary> BundleAdjuster::run(Budget* budget) {
  bool going_on = co_await begin(budget);
  if (!going_on) {
    summary_.initial_cost = summary_.final_cost = std::numeric_limits<double>::infinity();
    summary_.failed = true;
  }
  while (going_on && summary_.iterations < options_.max_iterations && lambda_ < kHopeless) {
    const bool at_gate = summary_.iterations >= options_.gate_after * options_.max_iterations;
    if (at_gate && !gate_passed_) {
      summary_.failed = !co_await gate(budget);
      if (summary_.failed) break;
    }
    going_on = co_await iterate(budget);
  }
  weighConstraints(1.0 / summary_.residual_sigma, &problem_);  // the next one has noise of its own
  co_return summary_;
}

Task<bool> BundleAdjuster::begin(Budget* budget) {
  whitened_ = co_await whitenViews(problem_, budget);
  if (options_.estimate_residual_sigma) {
    std::vector<double> squared;
    const bool seen = co_await cornerErrors(problem_, whitened_, &squared, budget);
    if (seen) summary_.residual_sigma = co_await residualSigma(squared, budget);
    options_.huber *= summary_.residual_sigma;
  }
  weighConstraints(summary_.residual_sigma, &problem_);
  const bool seen = co_await linearize(problem_, whitened_, options_.huber, &equations_, budget);
  if (!seen) co_return false;
  summary_.initial_cost = summary_.final_cost = equations_.cost;
  co_await budget->spend(
      kCopyPose * static_cast<double>(problem_.cameras.size() + problem_.observations.size()));
  trial_ = problem_;
  (void)co_await schur_.arrange(problem_, budget);
  co_return true;
}

Task<bool> BundleAdjuster::iterate(Budget* budget) {
  ++summary_.iterations;
  const bool solved = co_await schur_.solve(problem_, equations_, lambda_, &step_, budget);
  if (!solved) {
    lambda_ = std::max(10.0 * lambda_, 1e-6);
    summary_.failed = lambda_ >= kHopeless;
    co_return true;
  }
  double cost = std::numeric_limits<double>::infinity();
  const bool possible = co_await move(budget);
  if (possible) {
    const bool seen = co_await robustCost(trial_, whitened_, options_.huber, &cost, budget);
    if (!seen) cost = std::numeric_limits<double>::infinity();
  }
  if (!(cost <= summary_.final_cost)) {
    lambda_ = std::max(10.0 * lambda_, 1e-6);
    co_return true;
  }
  const double decrease = summary_.final_cost - cost;
  co_await budget->spend(kCopyPose *
                         static_cast<double>(problem_.cameras.size() + problem_.markers.size()));
  accept(cost);
  const bool seen = co_await linearize(problem_, whitened_, options_.huber, &equations_, budget);
  if (!seen) {
    summary_.failed = true;
    co_return false;
  }
  const double variance = summary_.residual_sigma * summary_.residual_sigma;
  if (decrease > std::min(options_.min_relative_decrease * cost, kNoticeable * variance))
    co_return true;
  // Converged, and done unless the gate has something to say.
  if (gate_passed_) co_return false;
  summary_.failed = !co_await gate(budget);
  co_return !summary_.failed && (summary_.gated_views > 0 || summary_.gated_constraints > 0);
}

Task<bool> BundleAdjuster::move(Budget* budget) {
  (void)co_await movePoses(problem_.cameras, step_.camera, &trial_.cameras, budget);
  (void)co_await movePoses(problem_.markers, step_.marker, &trial_.markers, budget);
  if (problem_.shutter) {
    trial_.shutter->readout_s = problem_.shutter->readout_s + step_.globals[9];
  }
  co_return !problem_.lens || moveLens(*problem_.lens, step_.globals.head<9>(), &*trial_.lens);
}

void BundleAdjuster::accept(double cost) {
  problem_.cameras = trial_.cameras;
  problem_.markers = trial_.markers;
  problem_.lens = trial_.lens;
  if (problem_.shutter) problem_.shutter->readout_s = trial_.shutter->readout_s;
  summary_.final_cost = cost;
  lambda_ = std::max(0.1 * lambda_, 1e-12);
}

Task<bool> BundleAdjuster::gate(Budget* budget) {
  gate_passed_ = true;
  if (!problem_.constraints.empty()) {
    const bool rest = co_await gateConstraints(budget);
    if (!rest) co_return false;
  }
  co_return co_await gateViews(budget);
}

Task<bool> BundleAdjuster::gateConstraints(Budget* budget) {
  if (!(problem_.constraint_gate > 0.0) || options_.view_chi2 <= 0.0) co_return true;
  const auto at = [](int index) { return static_cast<std::size_t>(index); };
  std::vector<double> squared(at(problem_.constraint_sources), 0.0);
  for (const BundleProblem::Constraint& constraint : problem_.constraints) {
    for (const BundleProblem::Relation& relation : constraint.relations) {
      co_await budget->spend(kTestConstraint);
      squared[at(relation.source)] +=
          contradiction(relation, problem_.cameras[at(constraint.camera)].T,
                        problem_.markers[at(constraint.marker)],
                        equations_.H_marker[at(constraint.marker)], options_.huber);
    }
  }
  const double worst = problem_.constraint_gate * summary_.residual_sigma;
  const auto isContradicted = [&](double sum) { return sum > worst * worst; };
  summary_.gated_constraints = static_cast<int>(std::ranges::count_if(squared, isContradicted));
  if (summary_.gated_constraints == 0) co_return true;
  for (BundleProblem* const problem : {&problem_, &trial_}) {
    for (BundleProblem::Constraint& constraint : problem->constraints) {
      for (BundleProblem::Relation& relation : constraint.relations) {
        if (isContradicted(squared[at(relation.source)])) relation.weight *= kLeftOut;
      }
    }
  }
  const bool rest = co_await linearize(problem_, whitened_, options_.huber, &equations_, budget);
  if (rest) summary_.final_cost = equations_.cost;
  co_return rest;
}

Task<bool> BundleAdjuster::gateViews(Budget* budget) {
  if (options_.view_chi2 <= 0.0) co_return true;
  std::vector<double> squared;
  const bool seen = co_await cornerErrors(problem_, whitened_, &squared, budget);
  if (!seen) co_return true;
  co_await budget->spend(kWeighView * static_cast<double>(problem_.observations.size()));
  gated_ = outlierViews(squared);
  if (gated_.empty()) co_return true;
  summary_.gated_views = static_cast<int>(gated_.size());
  for (const std::size_t view : gated_)
    whitened_[view].W.fill(Eigen::Matrix2d::Zero());  // no weight
  const bool rest = co_await linearize(problem_, whitened_, options_.huber, &equations_, budget);
  if (rest) summary_.final_cost = equations_.cost;
  co_return rest;
}

std::vector<std::size_t> BundleAdjuster::outlierViews(const std::vector<double>& squared) const {
  std::vector<std::size_t> outliers;
  std::vector<int> views_of_camera(problem_.cameras.size(), 0);
  std::vector<int> views_of_marker(problem_.markers.size(), 0);
  for (const BundleProblem::Observation& view : problem_.observations) {
    ++views_of_camera[static_cast<std::size_t>(view.camera)];
    ++views_of_marker[static_cast<std::size_t>(view.marker)];
  }
  const double worst = options_.view_chi2 * summary_.residual_sigma * summary_.residual_sigma;
  for (std::size_t i = 0; i < problem_.observations.size(); ++i) {
    const double* corners = squared.data() + 4 * i;
    if (corners[0] + corners[1] + corners[2] + corners[3] <= worst) continue;
    int& of_camera = views_of_camera[static_cast<std::size_t>(problem_.observations[i].camera)];
    int& of_marker = views_of_marker[static_cast<std::size_t>(problem_.observations[i].marker)];
    if (of_camera <= options_.min_views || of_marker <= options_.min_views) continue;
    --of_camera;
    --of_marker;
    outliers.push_back(i);
  }
  const auto views = static_cast<double>(problem_.observations.size());
  if (static_cast<double>(outliers.size()) > options_.max_gated_share * views) outliers.clear();
  return outliers;
}

Matrix6d BundleAdjuster::markerCovariance(int marker) const {
  return poseCovariance(equations_.H_marker[static_cast<std::size_t>(marker)],
                        summary_.residual_sigma);
}

Task<std::optional<GlobalMatrix>> BundleAdjuster::globalsCovariance(Budget* budget) {
  if (!problem_.hasGlobals()) co_return std::nullopt;
  const bool solved = co_await schur_.solve(problem_, equations_, 0.0, &step_, budget);
  auto covariance = solved ? schur_.globalsCovariance(problem_) : std::nullopt;
  if (!covariance || !covariance->allFinite()) co_return std::nullopt;
  *covariance *= summary_.residual_sigma * summary_.residual_sigma;
  co_return covariance;
}

Task<Done> movePoses(const std::vector<BundleProblem::Pose>& from,
                     const std::vector<Vector6d>& step, std::vector<BundleProblem::Pose>* to,
                     Budget* budget) {
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (from[i].fixed) continue;
    co_await budget->spend(kMovePose);
    (*to)[i].T = from[i].T.retract(step[i]);
  }
  co_return Done{};
}

BundleSummary adjustBundle(BundleProblem* problem, const BundleOptions& options) {
  BundleAdjuster adjuster(*problem, options);
  const BundleSummary summary =
      runToCompletion([&](Budget* budget) { return adjuster.run(budget); });
  *problem = adjuster.problem();
  return summary;
}

double bundleCost(const BundleProblem& problem, const BundleOptions& options) {
  double cost = 0.0;
  const auto whitened =
      runToCompletion([&](Budget* budget) { return whitenViews(problem, budget); });
  const bool seen = runToCompletion(
      [&](Budget* budget) { return robustCost(problem, whitened, options.huber, &cost, budget); });
  return seen ? cost : std::numeric_limits<double>::infinity();
}

}  // namespace waymark::slam
