#include "slam/optimization/map_fit.h"

#include <limits>

#include "slam/geometry/robust.h"
#include "slam/optimization/normal_equations.h"

namespace waymark::slam {

Task<MapFit> fitOf(const BundleProblem& problem, Budget* budget) {
  MapFit fit;
  const std::vector<WhitenedCorners> whitened = co_await whitenCorners(problem, budget);
  const bool seen = co_await cornerErrors(problem, whitened, &fit.squared, budget);
  if (seen) {
    fit.residual_sigma = residualSigmaOf(fit.squared);
  } else {
    fit.squared.assign(4 * problem.observations.size(), std::numeric_limits<double>::infinity());
  }
  co_return fit;
}

double costOf(std::span<const double> squared, double huber) {
  double sum = 0.0;
  for (const double error : squared) sum += huberCost(error, huber);
  return sum;
}

}  // namespace waymark::slam
