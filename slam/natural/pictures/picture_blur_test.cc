#include "slam/natural/pictures/picture_blur.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr int kSize_px = 60;

// Stripes, dark and light in turn across x.
ExpectedPicture stripes(double period_px) {
  ExpectedPicture picture;
  picture.width = kSize_px;
  picture.height = kSize_px;
  for (int y = 0; y < kSize_px; ++y) {
    for (int x = 0; x < kSize_px; ++x) {
      const double phase = 2.0 * std::numbers::pi * x / period_px;
      picture.grey.push_back(static_cast<float>(100.0 + 50.0 * std::sin(phase)));
    }
  }
  return picture;
}

// What is left of the stripes' contrast, away from the borders; negative when dark and light have
// changed places.
double contrastLeft(const ExpectedPicture& picture, const std::vector<float>& blurred) {
  double both = 0.0;
  double before = 0.0;
  for (int y = 20; y < kSize_px - 20; ++y) {
    for (int x = 20; x < kSize_px - 20; ++x) {
      const std::size_t i = picture.index(x, y);
      both += (picture.grey[i] - 100.0) * (blurred[i] - 100.0);
      before += (picture.grey[i] - 100.0) * (picture.grey[i] - 100.0);
    }
  }
  return both / before;
}

// A streak of L pixels across stripes of period P leaves sin(pi L / P) / (pi L / P).
double leftByStreak(double length_px, double period_px) {
  const double a = std::numbers::pi * length_px / period_px;
  return std::sin(a) / a;
}

double leftByGaussian(double variance_px2, double period_px) {
  const double w = 2.0 * std::numbers::pi / period_px;
  return std::exp(-0.5 * variance_px2 * w * w);
}

TEST(PictureBlur, AMovingCamerasIsAStreak) {
  constexpr double kLens_px2 = 0.64;  // narrower ones are not what their pixels sample
  for (const double length_px : {3.0, 6.0, 9.0}) {
    Eigen::Matrix2d across = kLens_px2 * Eigen::Matrix2d::Identity();
    across(0, 0) += length_px * length_px / 12.0;
    for (const double period_px : {5.0, 6.0, 12.0}) {
      const ExpectedPicture picture = stripes(period_px);
      EXPECT_NEAR(contrastLeft(picture, blurredPicture(picture, across)),
                  leftByStreak(length_px, period_px) * leftByGaussian(kLens_px2, period_px), 0.02)
          << length_px << ' ' << period_px;
      // Along the stripes it leaves them as they are, but for the lens.
      const Eigen::Matrix2d along = across.diagonal().reverse().asDiagonal();
      EXPECT_NEAR(contrastLeft(picture, blurredPicture(picture, along)),
                  leftByGaussian(kLens_px2, period_px), 0.02)
          << length_px << ' ' << period_px;
    }
  }
}

TEST(PictureBlur, ALensIsAGaussian) {
  for (const double sigma_px : {0.5, 1.0, 2.0}) {
    const ExpectedPicture picture = stripes(8.0);
    const Eigen::Matrix2d round = sigma_px * sigma_px * Eigen::Matrix2d::Identity();
    EXPECT_NEAR(contrastLeft(picture, blurredPicture(picture, round)),
                leftByGaussian(sigma_px * sigma_px, 8.0), 0.02);
    EXPECT_NEAR(widestBlur(round), sigma_px, 1e-9);
  }
}

TEST(PictureBlur, LimitsKeepTheDirections) {
  Eigen::Matrix2d blur;
  blur << 5.0, 4.9, 4.9, 5.0;  // 9.9 along the diagonal, 0.1 across
  const Eigen::Matrix2d limited = limitedBlur(blur, 1.0, 2.0);
  EXPECT_NEAR(Eigen::Vector2d(1, 1).dot(limited * Eigen::Vector2d(1, 1)), 2.0 * 4.0, 1e-9);
  EXPECT_NEAR(Eigen::Vector2d(1, -1).dot(limited * Eigen::Vector2d(1, -1)), 2.0 * 1.0, 1e-9);
}

}  // namespace
}  // namespace waymark::slam
