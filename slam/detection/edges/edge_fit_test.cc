#include "slam/detection/edges/edge_fit.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

struct Truth {
  double shift_start = 0.3;
  double shift_end = -0.2;
  double bow_px = 0.0;  // outwards
  double blur_px = 0.8;
  double noise = 0.0;       // grey levels
  double thickness = 6.0;   // of the border, pixels
  bool white_ring = false;  // the cells behind the border
  bool ring_known = true;
  double margin = 100.0;   // of the paper, pixels
  double behind = -100.0;  // grey levels against the paper's
};

double gaussian(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

// A straight edge 40 pixels long, seen by pixels on a grid.
EdgeRows render(const Truth& truth, double reach, std::mt19937* rng) {
  constexpr double kLength = 40.0;
  std::normal_distribution<double> noise(0.0, 1.0);
  EdgeRows rows;
  constexpr int kEnd = 3;
  rows.resize(static_cast<std::size_t>(kLength) - 2 * kEnd + 1,
              static_cast<std::size_t>(2.0 * reach) + 1);
  for (int along = kEnd; along <= kLength - kEnd; ++along) {
    const double t = along / kLength;
    const double nearest = std::ceil(-reach) + 0.37 * t;  // the grid is not aligned with the edge
    EdgeRow row;
    row.t = static_cast<float>(t);
    row.distance = static_cast<float>(nearest);
    row.step = 1.0F;
    row.innermost = -100.0F;
    row.outermost = 100.0F;
    row.to_start = static_cast<float>(along);
    row.to_end = static_cast<float>(kLength - along);
    row.thickness = static_cast<float>(truth.thickness);
    row.ring_white = truth.white_ring && truth.ring_known ? 1.0F : 0.0F;
    const auto number = static_cast<std::size_t>(along - kEnd);
    rows.set(number, row);
    const double shift = truth.shift_start + t * (truth.shift_end - truth.shift_start) +
                         4.0 * t * (1.0 - t) * truth.bow_px;
    for (std::size_t k = 0; k < rows.across(); ++k) {
      const double d = nearest + static_cast<double>(k);
      double dark = gaussian((shift - d) / truth.blur_px);
      if (truth.white_ring) dark -= gaussian((shift - d - truth.thickness) / truth.blur_px);
      const double beyond = gaussian((d - shift - truth.margin) / truth.blur_px);
      rows.setGrey(number, k,
                   static_cast<float>(200.0 - 160.0 * dark + truth.behind * beyond +
                                      truth.noise * noise(*rng)));
    }
  }
  rows.ignorePadding();
  return rows;
}

// Of every grey level, what `change` makes of it.
template <typename Change>
void changeGrey(EdgeRows* rows, const Change& change) {
  for (std::size_t i = 0; i < rows->rows(); ++i) {
    for (std::size_t k = 0; k < rows->across(); ++k) {
      rows->setGrey(i, k, change(rows->greyAt(i, k)));
    }
  }
}

class EdgeFitTest : public ::testing::Test {
 protected:
  // Of the start's shift, over many noisy edges.
  struct Errors {
    double bias_px = 0.0;
    double chi2 = 0.0;  // 1 where the covariance is that of the errors
  };
  Errors errorsOf(const Truth& truth, double reach) {
    constexpr int kTrials = 500;
    Errors errors;
    for (int i = 0; i < kTrials; ++i) {
      const auto fit = fitEdge(render(truth, reach, &rng_), {}, options_);
      EXPECT_TRUE(fit);
      if (!fit) break;
      const double error = fit->shift_start - truth.shift_start;
      errors.bias_px += error / kTrials;
      errors.chi2 += error * error / fit->covariance(0, 0) / kTrials;
    }
    return errors;
  }

  std::mt19937 rng_{1};
  EdgeFitOptions options_;
};

TEST_F(EdgeFitTest, FindsTheEdgeItsLevelsAndItsBlur) {
  for (const double blur : {0.6, 0.8, 1.5}) {
    Truth truth;
    truth.blur_px = blur;
    const auto fit = fitEdge(render(truth, 4.0, &rng_), {}, options_);
    ASSERT_TRUE(fit);
    EXPECT_NEAR(fit->shift_start, truth.shift_start, 0.005);
    EXPECT_NEAR(fit->shift_end, truth.shift_end, 0.005);
    EXPECT_NEAR(fit->white, 200.0, 0.5);
    EXPECT_NEAR(fit->black, 40.0, 0.5);
    EXPECT_NEAR(fit->blur_px, blur, 0.02);
  }
}

// The covariance is that of the errors over many noisy edges.
TEST_F(EdgeFitTest, CovarianceIsHonest) {
  Truth truth;
  truth.noise = 4.0;
  const Errors errors = errorsOf(truth, 3.0);
  EXPECT_NEAR(errors.chi2, 1.0, 0.25);
  EXPECT_LT(std::abs(errors.bias_px), 0.005);
}

TEST_F(EdgeFitTest, ABowShowsInTheResidualsOfAStraightEdge) {
  Truth truth;
  truth.noise = 2.0;
  double chi2_of_straight = 0.0;
  constexpr int kTrials = 100;
  for (int i = 0; i < kTrials; ++i) {
    const auto fit = fitEdge(render(truth, 3.0, &rng_), {}, options_);
    ASSERT_TRUE(fit);
    chi2_of_straight += fit->bow_px * fit->bow_px / fit->bow_variance / kTrials;
  }
  EXPECT_NEAR(chi2_of_straight, 1.0, 0.5);
  for (const double bow : {-0.5, 0.3}) {
    truth.bow_px = bow;
    const auto fit = fitEdge(render(truth, 3.0, &rng_), {}, options_);
    ASSERT_TRUE(fit);
    EXPECT_NEAR(fit->bow_px, bow, 0.1);
    EXPECT_GT(fit->bow_px * fit->bow_px, 25.0 * fit->bow_variance);
    EXPECT_GT(fit->bent_variance.minCoeff(), 0.0);
  }
}

// A white cell two and a half pixels behind the edge pulls an ignorant fit; knowing it is there
// takes the pull away.
TEST_F(EdgeFitTest, KnowingTheCodeRemovesItsPull) {
  Truth truth;
  truth.thickness = 2.5;
  truth.white_ring = true;
  const auto knowing = fitEdge(render(truth, 2.4, &rng_), {}, options_);
  truth.ring_known = false;
  const auto ignorant = fitEdge(render(truth, 2.4, &rng_), {}, options_);
  ASSERT_TRUE(knowing && ignorant);
  EXPECT_NEAR(knowing->shift_start, truth.shift_start, 0.01);
  EXPECT_GT(std::abs(ignorant->shift_start - truth.shift_start),
            4.0 * std::abs(knowing->shift_start - truth.shift_start));
}

// The cells lie behind the border wherever that is: a guess that is off moves neither. They were
// taken to begin where the guess has them, and a border of 2.5 pixels was 0.1 to 0.2 pixels off
// from a guess that was one pixel away.
TEST_F(EdgeFitTest, TheCellsAreWhereTheBorderEndsWhateverTheGuess) {
  for (const double off_px : {-1.0, -0.5, 0.5, 1.0}) {
    Truth truth;
    truth.shift_start = truth.shift_end = off_px;
    truth.thickness = 2.5;
    truth.white_ring = true;
    truth.blur_px = 1.2;
    const auto fit = fitEdge(render(truth, 3.5, &rng_), {}, options_);
    ASSERT_TRUE(fit) << off_px;
    EXPECT_NEAR(fit->shift_start, off_px, 0.02) << off_px;
    EXPECT_NEAR(fit->shift_end, off_px, 0.02) << off_px;
  }
}

// Two pixels beyond the edge the paper ends, whose margin may be somewhat narrower or wider than
// the border. While nothing was known of that, the wall behind it pulled the edge inwards by 0.14
// pixels.
TEST_F(EdgeFitTest, WhatIsBehindThePaperDoesNotPull) {
  for (const double behind : {-160.0, -80.0, 0.0, 40.0}) {
    for (const double margin : {1.8, 2.2, 2.6}) {
      Truth truth;
      truth.thickness = 2.2;
      truth.blur_px = 0.65;
      truth.margin = margin;
      truth.behind = behind;
      const auto fit = fitEdge(render(truth, 3.4, &rng_), {}, options_);
      ASSERT_TRUE(fit);
      EXPECT_NEAR(fit->shift_start, truth.shift_start, 0.02) << behind << ' ' << margin;
      EXPECT_NEAR(fit->shift_end, truth.shift_end, 0.02) << behind << ' ' << margin;
      if (behind == 0.0) continue;
      EXPECT_NEAR(fit->behind, behind, 0.1 * std::abs(behind)) << margin;
      EXPECT_NEAR(fit->margin_px, margin - truth.thickness, 0.1) << behind;
    }
  }
}

TEST_F(EdgeFitTest, CovarianceIsHonestWhereThePaperEnds) {
  Truth truth;
  truth.thickness = truth.margin = 2.2;
  truth.blur_px = 0.65;
  truth.noise = 4.0;
  const Errors errors = errorsOf(truth, 3.4);
  EXPECT_NEAR(errors.chi2, 1.0, 0.25);
  EXPECT_LT(std::abs(errors.bias_px), 0.01);
}

TEST_F(EdgeFitTest, AFewWrongPixelsDoNotMoveIt) {
  Truth truth;
  truth.noise = 1.0;
  auto rows = render(truth, 3.0, &rng_);
  int number = 0;
  changeGrey(&rows, [&](float grey) { return ++number % 23 == 0 ? 255.0F - grey : grey; });
  const auto fit = fitEdge(rows, {}, options_);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->shift_start, truth.shift_start, 0.05);
  EXPECT_NEAR(fit->shift_end, truth.shift_end, 0.05);
}

TEST_F(EdgeFitTest, RejectsWhatIsNoEdge) {
  EXPECT_FALSE(fitEdge(EdgeRows{}, {}, options_));
  Truth truth;
  auto flat = render(truth, 3.0, &rng_);
  changeGrey(&flat, [](float) { return 90.0F; });
  EXPECT_FALSE(fitEdge(flat, {}, options_));
  auto inverted = render(truth, 3.0, &rng_);
  // Light inside, dark outside.
  changeGrey(&inverted, [](float grey) { return 240.0F - grey; });
  EXPECT_FALSE(fitEdge(inverted, {}, options_));
}

}  // namespace
}  // namespace waymark::slam
