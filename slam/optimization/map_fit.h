// How well posed markers explain what keyframes saw.
#pragma once

#include <span>
#include <vector>

#include "base/task.h"
#include "slam/optimization/bundle_problem.h"

namespace waymark::slam {

struct MapFit {
  // Squared whitened errors of the corners, by observation; all infinite when one is behind its
  // camera.
  std::vector<double> squared;
  double residual_sigma = 1.0;  // standard deviation of the whitened residuals, at least 1
};

// As it is, without optimizing anything.
Task<MapFit> fitOf(const BundleProblem& problem, Budget* budget);

// Robust, of some squared errors. huber: the kernel's threshold, in units of the corners'
// covariances.
Task<double> costOf(std::span<const double> squared, double huber, Budget* budget);

}  // namespace waymark::slam
