#include "slam/optimization/map_fit.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "slam/geometry/robust.h"
#include "slam/optimization/normal_equations.h"
#include "slam/optimization/residual_sigma.h"

namespace waymark::slam {
namespace {

constexpr double kHuberCost = 0.004;  // microseconds of a core of 3 GHz

}  // namespace

Task<MapFit> fitOf(const BundleProblem& problem, Budget* budget) {
  MapFit fit;
  const std::vector<WhitenedView> whitened = co_await whitenViews(problem, budget);
  const bool seen = co_await cornerErrors(problem, whitened, &fit.squared, budget);
  if (seen) {
    fit.residual_sigma = co_await residualSigma(fit.squared, budget);
  } else {
    fit.squared.assign(4 * problem.observations.size(), std::numeric_limits<double>::infinity());
  }
  co_return fit;
}

Task<double> costOf(std::span<const double> squared, double huber, Budget* budget) {
  constexpr std::size_t kAtOnce = 256;
  double sum = 0.0;
  for (std::span<const double> left = squared; !left.empty();) {
    const std::span<const double> some = left.first(std::min(kAtOnce, left.size()));
    co_await budget->spend(kHuberCost * static_cast<double>(some.size()));
    for (const double error : some) sum += huberCost(error, huber);
    left = left.subspan(some.size());
  }
  co_return sum;
}

}  // namespace waymark::slam
