#include "slam/optimization/residual_sigma.h"

#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/geometry/robust.h"

namespace waymark::slam {
namespace {

std::vector<double> squaredNorms(std::size_t count, double sigma, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0.0, sigma);
  std::vector<double> squared(count);
  for (double& value : squared) {
    const double x = normal(random);
    const double y = normal(random);
    value = x * x + y * y;
  }
  return squared;
}

double atOnce(std::span<const double> squared) {
  return runToCompletion([&](Budget* budget) { return residualSigma(squared, budget); });
}

TEST(ResidualSigma, IsThatOfAllAtOnce) {
  for (const std::size_t count : {0U, 1U, 2U, 3U, 999U, 1000U, 1001U, 54321U}) {
    const std::vector<double> squared = squaredNorms(count, 1.7, count + 1);
    EXPECT_EQ(atOnce(squared), residualSigmaOf(squared)) << count;
  }
}

TEST(ResidualSigma, TakesEqualNormsAndInfiniteOnes) {
  std::vector<double> squared(5000, 4.0);
  EXPECT_EQ(atOnce(squared), residualSigmaOf(squared));
  for (std::size_t i = 0; i < squared.size(); i += 3) {
    squared[i] = std::numeric_limits<double>::infinity();
  }
  EXPECT_EQ(atOnce(squared), residualSigmaOf(squared));
}

TEST(ResidualSigma, SpendsAboutTheSameInEachSlice) {
  const std::vector<double> squared = squaredNorms(200'000, 1.2, 3);
  SlicedTask<double> task([&](Budget* budget) { return residualSigma(squared, budget); });
  int slices = 0;
  double most_overspent = 0.0;
  while (!task.advance(20.0)) {
    ++slices;
    most_overspent = std::min(most_overspent, task.left());
  }
  EXPECT_GT(slices, 50);
  EXPECT_GT(most_overspent, -10.0);
  EXPECT_EQ(task.take(), residualSigmaOf(squared));
}

}  // namespace
}  // namespace waymark::slam
