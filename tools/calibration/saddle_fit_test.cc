#include "tools/calibration/saddle_fit.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "tools/calibration/testing/drawn_board.h"

namespace waymark::calibration {
namespace {

constexpr int kSize = 31;  // pixels

struct Edges {
  Eigen::Vector2d at{15.3, 14.6};
  double angle_a = 0.2;
  double angle_b = 1.5;
};

Eigen::Vector2d direction(double angle) { return {std::cos(angle), std::sin(angle)}; }

// Pixels gather light over their area; the lens blurs.
cv::Mat crossing(const Edges& edges, double blur_px, double noise, unsigned seed) {
  constexpr int kSamples = 16;
  cv::Mat_<float> picture(kSize, kSize);
  const Eigen::Vector2d a(-direction(edges.angle_a).y(), direction(edges.angle_a).x());
  const Eigen::Vector2d b(-direction(edges.angle_b).y(), direction(edges.angle_b).x());
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      int white = 0;
      for (int s = 0; s < kSamples * kSamples; ++s) {
        const int row = s / kSamples;
        const Eigen::Vector2d point(x - 0.5 + (s % kSamples + 0.5) / kSamples,
                                    y - 0.5 + (row + 0.5) / kSamples);
        const Eigen::Vector2d offset = point - edges.at;
        if ((a.dot(offset) > 0.0) == (b.dot(offset) > 0.0)) ++white;
      }
      picture(y, x) = 40.0F + 160.0F * static_cast<float>(white) / (kSamples * kSamples);
    }
  }
  cv::GaussianBlur(picture, picture, {}, blur_px);
  std::mt19937 rng(seed);
  std::normal_distribution<float> grain(0.0F, static_cast<float>(noise));
  for (float& value : picture) value += noise > 0.0 ? grain(rng) : 0.0F;
  cv::Mat grey;
  picture.convertTo(grey, CV_8U);
  return grey;
}

std::optional<Saddle> fitted(const cv::Mat& picture, const Edges& edges) {
  return fitSaddle(testing::viewOf(picture), edges.at + Eigen::Vector2d(0.5, -0.7),
                   6.0 * direction(edges.angle_a + 0.05), 6.0 * direction(edges.angle_b - 0.05));
}

TEST(SaddleFit, WithoutNoiseItIsThere) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> unit(-0.5, 0.5);
  for (int i = 0; i < 40; ++i) {
    Edges edges;
    edges.at += Eigen::Vector2d(unit(rng), unit(rng));
    edges.angle_a = 3.0 * unit(rng);
    edges.angle_b = edges.angle_a + 1.5 + 0.8 * unit(rng);  // 63 to 109 degrees between them
    const auto saddle = fitted(crossing(edges, 0.5 + 0.02 * i, 0.0, 1), edges);
    ASSERT_TRUE(saddle) << i;
    EXPECT_LT((saddle->pixel - edges.at).norm(), 0.025) << i;
  }
}

TEST(SaddleFit, ItsCovarianceIsWhatNoiseDoes) {
  SaddleFitOptions options;
  options.systematic_sigma_px = 0.0;
  const Edges edges;
  double sum = 0.0;
  constexpr int kPictures = 200;
  for (int i = 0; i < kPictures; ++i) {
    const cv::Mat picture = crossing(edges, 0.8, 4.0, static_cast<unsigned>(i));
    const auto saddle =
        fitSaddle(testing::viewOf(picture), edges.at, 6.0 * direction(edges.angle_a),
                  6.0 * direction(edges.angle_b), options);
    ASSERT_TRUE(saddle);
    const Eigen::Vector2d error = saddle->pixel - edges.at;
    sum += error.dot(saddle->covariance.inverse() * error);
  }
  EXPECT_NEAR(sum / kPictures, 2.0, 0.5);
}

TEST(SaddleFit, WhatIsNoCrossing) {
  const Edges edges;
  EXPECT_FALSE(fitted(cv::Mat(kSize, kSize, CV_8UC1, cv::Scalar(128)), edges));
  cv::Mat step(kSize, kSize, CV_8UC1, cv::Scalar(40));
  step.colRange(15, kSize).setTo(200);
  EXPECT_FALSE(fitted(step, edges));
  // Too near the border.
  EXPECT_FALSE(
      fitSaddle(testing::viewOf(crossing(edges, 0.8, 0.0, 1)), {3.0, 15.0}, {6, 0}, {0, 6}));
}

}  // namespace
}  // namespace waymark::calibration
