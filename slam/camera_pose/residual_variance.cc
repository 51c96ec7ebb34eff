#include "slam/camera_pose/residual_variance.h"

#include <algorithm>
#include <cmath>

#include "slam/option_checks.h"

namespace waymark::slam {

std::string ResidualVarianceOptions::invalidReason() const {
  return firstUnmet({{isPositive(prior_dof), "prior_dof must be positive"},
                     {isPositive(memory_dof), "memory_dof must be positive"}});
}

double unexplainedVariance(double chi2, double degrees_of_freedom) {
  constexpr double kNormalQuantile = 2.326;
  const double v = 2.0 / (9.0 * degrees_of_freedom);
  const double root = 1.0 - v + kNormalQuantile * std::sqrt(v);
  return std::max(1.0, chi2 / (degrees_of_freedom * root * root * root));
}

void ResidualVariance::add(double chi2, double degrees_of_freedom) {
  chi2_ += chi2;
  dof_ += degrees_of_freedom;
  if (dof_ <= options_.memory_dof) return;
  const double kept = options_.memory_dof / dof_;
  chi2_ *= kept;
  dof_ *= kept;
}

double ResidualVariance::value() const {
  return std::max(1.0, (options_.prior_dof + chi2_) / (options_.prior_dof + dof_));
}

}  // namespace waymark::slam
