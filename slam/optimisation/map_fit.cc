#include "slam/optimisation/map_fit.h"

#include <limits>

#include "slam/geometry/robust.h"
#include "slam/optimisation/normal_equations.h"

namespace waymark::slam {

Task<MapFit> fitOf(const BundleProblem& problem, Allowance* allowance) {
  MapFit fit;
  const std::vector<WhitenedCorners> whitened = co_await whitenCorners(problem, allowance);
  const bool seen = co_await cornerErrors(problem, whitened, &fit.squared, allowance);
  if (seen) {
    fit.noise = noiseScale(fit.squared);
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
