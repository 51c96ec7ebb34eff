// The normal equations of a bundle adjustment, kept in blocks, and their solution by the Schur
// complement.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "slam/geometry/reprojection.h"
#include "slam/optimisation/bundle_problem.h"

namespace waymark::slam {

// W^T W = covariance^-1 for each corner of an observation: of normalised coordinates, or of pixels
// when the lens is an unknown.
using WhitenedCorners = std::array<Eigen::Matrix2d, 4>;
[[nodiscard]] std::vector<WhitenedCorners> whitenCorners(const BundleProblem& problem);

// One 6x6 block per camera, per marker, and per observation between them; and the globals' at the
// end, where there are any.
struct NormalEquations {
  std::vector<Matrix6d> H_camera, H_marker;
  std::vector<Vector6d> g_camera, g_marker;
  std::vector<Matrix6d> H_cross;  // camera rows, marker columns; by observation
  std::vector<PoseGlobalMatrix> H_camera_global, H_marker_global;  // empty without globals
  GlobalMatrix H_global = GlobalMatrix::Zero();
  GlobalVector g_global = GlobalVector::Zero();
  double cost = 0.0;
};

// Robust cost alone; false when a corner is behind its camera.
[[nodiscard]] bool robustCost(const BundleProblem& problem,
                              const std::vector<WhitenedCorners>& whitened, double huber,
                              double* cost);
// Squared whitened residual norm of every corner, in the order of the observations; false when one
// is behind its camera.
[[nodiscard]] bool cornerErrors(const BundleProblem& problem,
                                const std::vector<WhitenedCorners>& whitened,
                                std::vector<double>* squared);
// False when a corner is behind its camera.
[[nodiscard]] bool linearise(const BundleProblem& problem,
                             const std::vector<WhitenedCorners>& whitened, double huber,
                             NormalEquations* equations);

struct BundleStep {
  std::vector<Vector6d> camera, marker;  // zero for fixed poses
  GlobalVector globals = GlobalVector::Zero();
};

// Solves the damped equations; false when they are singular.
[[nodiscard]] bool solveStep(const BundleProblem& problem, const NormalEquations& equations,
                             double lambda, BundleStep* step);

// Variance of the readout time, whitened, all other unknowns free as well. Empty when it is none.
[[nodiscard]] std::optional<double> readoutVariance(const BundleProblem& problem,
                                                    const NormalEquations& equations);

}  // namespace waymark::slam
