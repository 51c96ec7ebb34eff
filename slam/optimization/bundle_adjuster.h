// Joint optimization of keyframe and marker poses: the solver behind local (seed 1, section 4.7)
// and global optimization (section 4.10).
//
// Levenberg-Marquardt on Eq. 33 (Eq. 41 with intrinsics) with Huber's kernel and the corners'
// covariances as weights. Every pose has 6 unknowns; the more numerous kind (keyframes or markers)
// is eliminated by the Schur complement, block by block, and the rest solved as one system.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/task.h"
#include "slam/optimization/bundle_problem.h"
#include "slam/optimization/normal_equations.h"
#include "slam/optimization/schur_complement.h"

namespace waymark::slam {

struct BundleOptions {
  // More come nearer to the optimum and cost time.
  int max_iterations = 10;
  // Stop when an iteration lowers the cost by less than this share of it, and by less than chance
  // makes of it.
  double min_relative_decrease = 1e-4;
  // Huber's threshold on a corner's whitened residual norm, in units of the noise.
  double huber = 2.45;
  // Take the noise from the residuals at the start (their median), where it exceeds what the
  // corners' covariances say; else from the covariances alone.
  bool estimate_residual_sigma = true;
  // Views of a marker that fit worse than this at the gate take no part in the rest of the
  // adjustment: chi-square of 8 residuals, in units of the noise; 26.1 is the 99.9 % quantile, but
  // lenses and bent paper have wider tails. 0 for no gate.
  double view_chi2 = 60.0;
  // The gate comes after this share of max_iterations, or before, where the cost has converged.
  // Earlier, good views are still far off with their poses; later, few iterations are left without
  // the others.
  double gate_after = 0.5;
  // Views that every pose keeps, however they fit: from one the pose is ambiguous.
  int min_views = 2;
  // When a larger share of the views would go, none does: so many are no outliers, the model is
  // wrong or far from converged.
  double max_gated_share = 0.25;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct BundleSummary {
  double initial_cost = 0.0;  // robust, whitened
  double final_cost = 0.0;
  int iterations = 0;
  // Standard deviation of the whitened residuals at the start; 1 when it was not estimated.
  double residual_sigma = 1.0;
  int gated_views = 0;        // left out after the gate
  int gated_constraints = 0;  // likewise: sources (BundleProblem::Relation)
  // A step could not be computed (singular problem): the poses are the best found so far.
  bool failed = false;
};

class BundleAdjuster {
 public:
  // At least one pose should be fixed or have a prior, or the gauge floats (and is held by the
  // damping only). The detections must outlive the adjuster.
  BundleAdjuster(BundleProblem problem, const BundleOptions& options)
      : problem_(std::move(problem)), options_(options) {}

  // All of it; once.
  Task<BundleSummary> run(Budget* budget);

  // The best poses found; after run().
  [[nodiscard]] const BundleProblem& problem() const { return problem_; }
  [[nodiscard]] const BundleSummary& summary() const { return summary_; }
  // The observations that were left out after the gate, ascending.
  [[nodiscard]] const std::vector<std::size_t>& gatedViews() const { return gated_; }
  // Of a marker's (dp, dtheta), given the cameras: the inverse of its own block of the normal
  // equations, scaled by the noise. Zero for a marker nobody sees.
  [[nodiscard]] Matrix6d markerCovariance(int marker) const;
  // Of the intrinsics and the readout time (seconds), all poses free as well, scaled by the noise;
  // empty when they are no unknowns or cannot be known.
  Task<std::optional<GlobalMatrix>> globalsCovariance(Budget* budget);

 private:
  // Weights, noise and the first linearization; false when a corner is behind its camera.
  Task<bool> begin(Budget* budget);
  // One iteration. False when it was the last one.
  Task<bool> iterate(Budget* budget);
  // Applies step_ to the trial. False when it leaves what a lens can be.
  Task<bool> move(Budget* budget);
  void accept(double cost);
  // Leaves gross views, and what they contradict, out from here on. False when the rest has no
  // cost.
  Task<bool> gate(Budget* budget);
  Task<bool> gateConstraints(Budget* budget);
  Task<bool> gateViews(Budget* budget);
  [[nodiscard]] std::vector<std::size_t> outlierViews(const std::vector<double>& squared) const;

  BundleProblem problem_;
  BundleProblem trial_;
  std::vector<WhitenedView> whitened_;  // by observation
  NormalEquations equations_;           // at problem_
  SchurComplement schur_;
  BundleStep step_;
  BundleOptions options_;
  BundleSummary summary_;
  double lambda_ = 1e-5;  // damping; where it starts only sets the length of the first steps
  bool gate_passed_ = false;
  std::vector<std::size_t> gated_;
};

// A step of every pose; fixed ones stay bit-identical.
Task<Done> movePoses(const std::vector<BundleProblem::Pose>& from,
                     const std::vector<Vector6d>& step, std::vector<BundleProblem::Pose>* to,
                     Budget* budget);

// All at once; improves the problem in place.
BundleSummary adjustBundle(BundleProblem* problem, const BundleOptions& options = {});

// The robust cost of the problem as it stands; infinite when a corner is behind its camera.
[[nodiscard]] double bundleCost(const BundleProblem& problem, const BundleOptions& options = {});

}  // namespace waymark::slam
