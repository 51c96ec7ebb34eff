#include "slam/camera_pose/residual_variance.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

// From tables of the chi-square distribution.
TEST(UnexplainedVariance, IsOneUpToTheQuantile) {
  for (const auto& [dof, quantile] : {std::pair{2.0, 9.210}, {10.0, 23.209}, {26.0, 45.642}}) {
    EXPECT_DOUBLE_EQ(unexplainedVariance(0.97 * quantile, dof), 1.0) << dof;
    EXPECT_NEAR(unexplainedVariance(3.0 * quantile, dof), 3.0, 0.06) << dof;
  }
}

// Residuals of which none is larger than said give no larger covariances, or hardly.
TEST(ResidualVariance, TakesNoChanceForNoise) {
  std::mt19937 rng(3);
  std::chi_squared_distribution<double> chi2(10.0);
  double sum = 0.0;
  constexpr int kRuns = 200;
  for (int run = 0; run < kRuns; ++run) {
    ResidualVariance variance({});
    double worst = 1.0;
    for (int i = 0; i < 100; ++i) {
      variance.add(chi2(rng), 10.0);
      worst = std::max(worst, variance.value());
    }
    sum += variance.value();
    EXPECT_LT(worst, 1.35);
  }
  EXPECT_LT(sum / kRuns, 1.03);
}

// Residuals of twice the standard deviation: seen within some frames, and forgotten again.
TEST(ResidualVariance, FollowsTheNoise) {
  std::mt19937 rng(5);
  std::chi_squared_distribution<double> chi2(26.0);
  ResidualVariance variance({});
  for (int i = 0; i < 20; ++i) variance.add(4.0 * chi2(rng), 26.0);
  EXPECT_NEAR(variance.value(), 4.0, 0.8);
  for (int i = 0; i < 300; ++i) variance.add(chi2(rng), 26.0);
  EXPECT_LT(variance.value(), 1.15);
}

TEST(ResidualVariance, IsOneWithoutResiduals) {
  EXPECT_DOUBLE_EQ(ResidualVariance({}).value(), 1.0);
}

TEST(ResidualVarianceOptions, RefusesWhatIsNoNumberOfResiduals) {
  EXPECT_EQ(ResidualVarianceOptions{}.invalidReason(), "");
  EXPECT_EQ(ResidualVarianceOptions{.prior_dof = 0.0}.invalidReason(),
            "prior_dof must be positive");
  EXPECT_EQ(ResidualVarianceOptions{.memory_dof = std::nan("")}.invalidReason(),
            "memory_dof must be positive");
}

}  // namespace
}  // namespace waymark::slam
