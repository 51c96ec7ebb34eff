#include "slam/detection/codes/code_likeness.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

class CodeLikenessTest : public ::testing::Test {
 protected:
  // Of the cells, of a print blurred so that neighbours have this share of a cell's level, under a
  // light that changes by so much from side to side.
  [[nodiscard]] std::vector<float> levels(int id, double blur = 0.0, double slope = 0.0) const {
    const int cells = dictionary_.cells();
    const auto whiteness = [&](int row, int column) {
      const bool outside = row < 0 || column < 0 || row >= cells || column >= cells;
      return outside || dictionary_.white(id, row, column) ? 1.0 : 0.0;
    };
    std::vector<float> grey;
    for (int row = 0; row < cells; ++row) {
      for (int column = 0; column < cells; ++column) {
        const double around = 0.25 * (whiteness(row - 1, column) + whiteness(row + 1, column) +
                                      whiteness(row, column - 1) + whiteness(row, column + 1));
        const double white = (1.0 - blur) * whiteness(row, column) + blur * around;
        grey.push_back(static_cast<float>(40.0 + 150.0 * white + slope * column / cells));
      }
    }
    return grey;
  }
  [[nodiscard]] static std::vector<float> noisy(std::vector<float> grey, double sigma,
                                                std::mt19937* rng) {
    std::normal_distribution<float> noise(0.0F, static_cast<float>(sigma));
    for (float& level : grey) level += noise(*rng);
    return grey;
  }

  Dictionary dictionary_ = *Dictionary::byName("4X4_50");
};

TEST_F(CodeLikenessTest, APrintExplainsItselfBlurredAndUnevenlyLit) {
  for (const double blur : {0.0, 0.2, 0.5}) {
    for (const double slope : {0.0, 60.0}) {
      const auto grey = levels(17, blur, slope);
      EXPECT_NEAR(codeLikeness(dictionary_, 17, grey, 0.0), 1.0, 1e-6) << blur << ", " << slope;
    }
  }
}

TEST_F(CodeLikenessTest, NoiseThatIsKnownTakesNothingOff) {
  std::mt19937 rng(3);
  constexpr double kSigma = 25.0;
  double with = 0.0;
  double without = 0.0;
  constexpr int kRuns = 200;
  for (int run = 0; run < kRuns; ++run) {
    const auto grey = noisy(levels(17, 0.3), kSigma, &rng);
    with += codeLikeness(dictionary_, 17, grey, kSigma * kSigma) / kRuns;
    without += codeLikeness(dictionary_, 17, grey, 0.0) / kRuns;
  }
  EXPECT_GT(with, 0.95);
  EXPECT_LT(without, 0.9);
}

TEST_F(CodeLikenessTest, AWrongCellCostsLittle) {
  auto grey = levels(17, 0.2);
  grey[7] = 230.0F - grey[7];  // of the code's first cell, the other colour
  const double likeness = codeLikeness(dictionary_, 17, grey, 0.0);
  EXPECT_GT(likeness, 0.7);
  EXPECT_LT(likeness, 0.95);
}

// On the right side of the threshold, each of them, but by as much as chance has it.
TEST_F(CodeLikenessTest, APhotographThatReadsAsTheCodeIsUnlike) {
  std::mt19937 rng(5);
  std::exponential_distribution<double> off(1.0 / 35.0);
  constexpr int kRuns = 200;
  double sum = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    std::vector<float> grey;
    for (const float print : levels(17)) {
      const double sign = print > 100.0F ? 1.0 : -1.0;
      grey.push_back(static_cast<float>(115.0 + sign * (2.0 + off(rng))));
    }
    sum += codeLikeness(dictionary_, 17, grey, 0.0) / kRuns;
  }
  EXPECT_LT(sum, 0.6);
}

TEST_F(CodeLikenessTest, AnInvertedOrUniformPrintIsNoneAtAll) {
  auto inverted = levels(17);
  for (float& level : inverted) level = 230.0F - level;
  EXPECT_EQ(codeLikeness(dictionary_, 17, inverted, 0.0), 0.0);
  EXPECT_EQ(codeLikeness(dictionary_, 17, std::vector<float>(inverted.size(), 100.0F), 0.0), 0.0);
}

}  // namespace
}  // namespace waymark::slam
