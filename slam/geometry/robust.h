// Huber's kernel and a robust estimate of the noise, shared by the solvers.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "base/stack_arena.h"

namespace waymark::slam {

// Cost of a squared residual norm: quadratic up to k, linear beyond.
[[nodiscard]] inline double huberCost(double squared, double k) {
  return squared <= k * k ? squared : 2.0 * k * std::sqrt(squared) - k * k;
}

// The weight that makes iterated least squares minimize it.
[[nodiscard]] inline double huberWeight(double squared, double k) {
  return squared <= k * k ? 1.0 : k / std::sqrt(squared);
}

// Precondition: not empty. The upper one of two middle values.
template <typename Vector>
[[nodiscard]] typename Vector::value_type median(Vector values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Standard deviation of whitened residuals, from the squared norms of two-dimensional ones: 1 when
// the covariances tell all, more where lens model, blur or paper add to them; never less than 1.
[[nodiscard]] inline double residualSigmaOf(std::span<const double> squared_norms) {
  constexpr double kMedianOfChi2With2 = 1.386;
  if (squared_norms.empty()) return 1.0;
  StackArena<4096> arena;
  std::pmr::vector<double> copy(squared_norms.begin(), squared_norms.end(), arena.get());
  return std::sqrt(std::max(1.0, median(std::move(copy)) / kMedianOfChi2With2));
}

}  // namespace waymark::slam
