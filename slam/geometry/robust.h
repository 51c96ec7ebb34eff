// Huber's kernel and a robust estimate of the noise, shared by the solvers.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace waymark::slam {

// Cost of a squared residual norm: quadratic up to k, linear beyond.
[[nodiscard]] inline double huberCost(double squared, double k) {
  return squared <= k * k ? squared : 2.0 * k * std::sqrt(squared) - k * k;
}

// The weight that makes iterated least squares minimise it.
[[nodiscard]] inline double huberWeight(double squared, double k) {
  return squared <= k * k ? 1.0 : k / std::sqrt(squared);
}

// Precondition: not empty. The upper one of two middle values.
template <typename T>
[[nodiscard]] T median(std::vector<T> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Standard deviation of whitened residuals, from the squared norms of two-dimensional ones: 1 when
// the covariances tell all, more where lens model, blur or paper add to them; never less than 1.
[[nodiscard]] inline double noiseScale(const std::vector<double>& squared_norms) {
  constexpr double kMedianOfChi2With2 = 1.386;
  if (squared_norms.empty()) return 1.0;
  return std::sqrt(std::max(1.0, median(squared_norms) / kMedianOfChi2With2));
}

}  // namespace waymark::slam
