#include "slam/optimization/residual_sigma.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "slam/geometry/robust.h"

namespace waymark::slam {
namespace {

constexpr double kLookAtNorm = 0.0055;  // microseconds of a core of 3 GHz
constexpr std::size_t kAtOnce = 1000;   // norms: some microseconds' worth

double middleOfThree(double a, double b, double c) {
  return std::max(std::min(a, b), std::min(std::max(a, b), c));
}

// From one place between slices to the next.
Task<Done> payFor(std::size_t norms, Budget* budget) {
  co_await budget->spend(kLookAtNorm * static_cast<double>(norms));
  co_return Done{};
}

}  // namespace

Task<double> residualSigma(std::span<const double> squared_norms, Budget* budget) {
  std::vector<double> left;  // those that may be the median, and which of them it is
  left.reserve(squared_norms.size());
  for (std::size_t begin = 0; begin < squared_norms.size(); begin += kAtOnce) {
    const auto some = squared_norms.subspan(begin, std::min(kAtOnce, squared_norms.size() - begin));
    (void)co_await payFor(some.size(), budget);
    left.insert(left.end(), some.begin(), some.end());
  }
  std::size_t rank = left.size() / 2;
  while (left.size() > kAtOnce) {
    const double pivot = middleOfThree(left.front(), left[left.size() / 2], left.back());
    std::vector<double> below;
    std::vector<double> above;
    for (std::size_t begin = 0; begin < left.size(); begin += kAtOnce) {
      const std::size_t end = std::min(begin + kAtOnce, left.size());
      (void)co_await payFor(end - begin, budget);
      for (std::size_t i = begin; i < end; ++i) {
        if (left[i] < pivot) below.push_back(left[i]);
        if (left[i] > pivot) above.push_back(left[i]);
      }
    }
    const std::size_t equal = left.size() - below.size() - above.size();
    if (rank < below.size()) {
      left = std::move(below);
    } else if (rank < below.size() + equal) {
      left.assign(1, pivot);
      rank = 0;
    } else {
      rank -= below.size() + equal;
      left = std::move(above);
    }
  }
  if (left.empty()) co_return residualSigmaOf({});
  std::ranges::nth_element(left, left.begin() + static_cast<std::ptrdiff_t>(rank));
  const double middle = left[rank];
  co_return residualSigmaOf({&middle, 1});
}

}  // namespace waymark::slam
