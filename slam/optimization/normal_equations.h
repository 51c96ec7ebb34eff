// The normal equations of a bundle adjustment, kept in blocks; and the residuals alone. In slices.
#pragma once

#include <array>
#include <vector>

#include "base/task.h"
#include "slam/geometry/reprojection.h"
#include "slam/optimization/bundle_problem.h"

namespace waymark::slam {

// What an optimization needs of an observation in every iteration, side by side in memory: the
// detections are all over it.
struct WhitenedView {
  WhitenedCorners W;  // of normalized coordinates, or of pixels when the lens is an unknown
  std::array<Eigen::Vector2d, 4> seen;  // as the detection has them, normalized
};
// Of each observation.
Task<std::vector<WhitenedView>> whitenViews(const BundleProblem& problem, Budget* budget);

// One 6x6 block per camera, per marker, and per tie between them; and the globals' at the
// end, where there are any.
struct NormalEquations {
  std::vector<Matrix6d> H_camera, H_marker;
  std::vector<Vector6d> g_camera, g_marker;
  std::vector<Matrix6d> H_cross;  // camera rows, marker columns; by tie
  std::vector<PoseGlobalMatrix> H_camera_global, H_marker_global;  // empty without globals
  GlobalMatrix H_global = GlobalMatrix::Zero();
  GlobalVector g_global = GlobalVector::Zero();
  double cost = 0.0;
};

// Of a pose whose block is H, all else held, where the whitened residuals have that noise. Zero for
// one that nothing observes.
[[nodiscard]] Matrix6d poseCovariance(const Matrix6d& H, double residual_sigma);

// Robust cost alone; false when a corner is behind its camera.
Task<bool> robustCost(const BundleProblem& problem, const std::vector<WhitenedView>& whitened,
                      double huber, double* cost, Budget* budget);
// Squared whitened residual norm of every corner, in the order of the observations; false when one
// is behind its camera.
Task<bool> cornerErrors(const BundleProblem& problem, const std::vector<WhitenedView>& whitened,
                        std::vector<double>* squared, Budget* budget);
// False when a corner is behind its camera.
Task<bool> linearize(const BundleProblem& problem, const std::vector<WhitenedView>& whitened,
                     double huber, NormalEquations* equations, Budget* budget);

}  // namespace waymark::slam
