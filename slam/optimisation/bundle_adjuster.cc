#include "slam/optimisation/bundle_adjuster.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/Cholesky>

#include "slam/geometry/robust.h"

namespace waymark::slam {
namespace {

constexpr double kHopeless = 1e10;  // damping beyond which no step will help

// Fixed poses stay bit-identical.
void movePoses(const std::vector<BundleProblem::Pose>& from, const std::vector<Vector6d>& step,
               std::vector<BundleProblem::Pose>* to) {
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (!from[i].fixed) (*to)[i].T = from[i].T.retract(step[i]);
  }
}

// False when the step leaves what a lens can be.
bool moveLens(const BundleProblem::Lens& from, const IntrinsicVector& step,
              BundleProblem::Lens* to) {
  const Calibration moved = from.camera.withIntrinsics(from.camera.intrinsics() + step);
  if (!moved.invalidReason().empty()) return false;
  to->camera = CameraModel(moved);
  return true;
}

}  // namespace

BundleAdjuster::BundleAdjuster(BundleProblem problem, const BundleOptions& options)
    : problem_(std::move(problem)), whitened_(whitenCorners(problem_)), options_(options) {
  std::vector<double> squared;
  if (options_.estimate_noise && cornerErrors(problem_, whitened_, &squared)) {
    summary_.noise = noiseScale(squared);
    options_.huber *= summary_.noise;
  }
  if (!linearise(problem_, whitened_, options_.huber, &equations_)) {
    summary_.initial_cost = summary_.final_cost = std::numeric_limits<double>::infinity();
    summary_.failed = done_ = true;
    return;
  }
  summary_.initial_cost = summary_.final_cost = equations_.cost;
  trial_ = problem_;
}

bool BundleAdjuster::step() {
  if (done_ || summary_.iterations >= options_.max_iterations || lambda_ >= kHopeless) return false;
  if (!gate_passed_ && 2 * summary_.iterations >= options_.max_iterations && !gateViews()) {
    summary_.failed = done_ = true;
    return false;
  }
  ++summary_.iterations;
  BundleStep step;
  if (!solveStep(problem_, equations_, lambda_, &step)) {
    lambda_ = std::max(10.0 * lambda_, 1e-6);
    summary_.failed = lambda_ >= kHopeless;
    return true;
  }
  movePoses(problem_.cameras, step.camera, &trial_.cameras);
  movePoses(problem_.markers, step.marker, &trial_.markers);
  const bool lens_ok =
      !problem_.lens || moveLens(*problem_.lens, step.globals.head<9>(), &*trial_.lens);
  if (problem_.shutter) {
    trial_.shutter->readout_s = problem_.shutter->readout_s + step.globals[9];
  }
  double cost = 0.0;
  if (!lens_ok || !robustCost(trial_, whitened_, options_.huber, &cost) ||
      !(cost <= summary_.final_cost)) {
    lambda_ = std::max(10.0 * lambda_, 1e-6);
    return true;
  }
  const double decrease = summary_.final_cost - cost;
  problem_.cameras = trial_.cameras;
  problem_.markers = trial_.markers;
  problem_.lens = trial_.lens;
  if (problem_.shutter) problem_.shutter->readout_s = trial_.shutter->readout_s;
  summary_.final_cost = cost;
  lambda_ = std::max(0.1 * lambda_, 1e-12);
  if (!linearise(problem_, whitened_, options_.huber, &equations_)) {
    summary_.failed = done_ = true;
    return true;
  }
  if (decrease > options_.min_relative_decrease * cost) return true;
  // Converged, and done unless the gate has something to say.
  const int gated_before = summary_.gated_views;
  if (!gate_passed_ && !gateViews()) summary_.failed = true;
  done_ = summary_.failed || summary_.gated_views == gated_before;
  return true;
}

bool BundleAdjuster::gateViews() {
  gate_passed_ = true;
  const std::vector<std::size_t> gross = grossViews();
  if (gross.empty()) return true;
  summary_.gated_views = static_cast<int>(gross.size());
  for (const std::size_t view : gross) whitened_[view].fill(Eigen::Matrix2d::Zero());  // no weight
  if (!linearise(problem_, whitened_, options_.huber, &equations_)) return false;
  summary_.final_cost = equations_.cost;
  return true;
}

std::vector<std::size_t> BundleAdjuster::grossViews() const {
  std::vector<std::size_t> gross;
  std::vector<double> squared;
  if (options_.view_chi2 <= 0.0 || !cornerErrors(problem_, whitened_, &squared)) return gross;
  std::vector<int> views_of_camera(problem_.cameras.size(), 0);
  std::vector<int> views_of_marker(problem_.markers.size(), 0);
  for (const BundleProblem::Observation& view : problem_.observations) {
    ++views_of_camera[static_cast<std::size_t>(view.camera)];
    ++views_of_marker[static_cast<std::size_t>(view.marker)];
  }
  constexpr int kKept = 2;
  const double worst = options_.view_chi2 * summary_.noise * summary_.noise;
  for (std::size_t i = 0; i < problem_.observations.size(); ++i) {
    const double* corners = squared.data() + 4 * i;
    if (corners[0] + corners[1] + corners[2] + corners[3] <= worst) continue;
    int& of_camera = views_of_camera[static_cast<std::size_t>(problem_.observations[i].camera)];
    int& of_marker = views_of_marker[static_cast<std::size_t>(problem_.observations[i].marker)];
    if (of_camera <= kKept || of_marker <= kKept) continue;
    --of_camera;
    --of_marker;
    gross.push_back(i);
  }
  // So many are no outliers: the model is wrong, or far from converged.
  if (4 * gross.size() > problem_.observations.size()) gross.clear();
  return gross;
}

Matrix6d BundleAdjuster::markerCovariance(int marker) const {
  const Matrix6d& H = equations_.H_marker[static_cast<std::size_t>(marker)];
  if (H.isZero()) return Matrix6d::Zero();
  return summary_.noise * summary_.noise * H.ldlt().solve(Matrix6d::Identity());
}

std::optional<double> BundleAdjuster::readoutSigma_s() const {
  const auto variance = readoutVariance(problem_, equations_);
  if (!variance || !(*variance > 0.0)) return std::nullopt;
  return summary_.noise * std::sqrt(*variance);
}

BundleSummary adjustBundle(BundleProblem* problem, const BundleOptions& options) {
  BundleAdjuster adjuster(*problem, options);
  while (adjuster.step()) {
  }
  *problem = adjuster.problem();
  return adjuster.summary();
}

double bundleCost(const BundleProblem& problem, const BundleOptions& options) {
  double cost = 0.0;
  const bool seen = robustCost(problem, whitenCorners(problem), options.huber, &cost);
  return seen ? cost : std::numeric_limits<double>::infinity();
}

}  // namespace waymark::slam
