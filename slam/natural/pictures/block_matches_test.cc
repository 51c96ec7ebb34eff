#include "slam/natural/pictures/block_matches.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "slam/testing/seen_picture.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kWidth_m = 0.3;

class BlockMatchesTest : public ::testing::Test {
 protected:
  [[nodiscard]] cv::Mat seen(const Transform& T_c_p) const {
    return testing::seenPicture(scene_, print_, kWidth_m, marker_.height_m(), T_c_p, 1);
  }
  // Of the picture, expected at T_c_p.
  [[nodiscard]] std::vector<PrintPoint> match(const cv::Mat& image, const Transform& T_c_p) {
    const GreyPyramid pyramid(testing::viewOf(image), 40);
    const auto expected = expectPicture(marker_, T_c_p, 0, 2, &rays_);
    const PhotometricFit fit(*expected, expected->grey, 1.0, T_c_p, scene_.camera,
                             pyramid.level(0));
    return matchBlocks(fit.pixels(), pyramid.level(0), 0, scene_.camera);
  }
  [[nodiscard]] double offBy_px(const PrintPoint& match, const Transform& T_c_p) const {
    const Eigen::Vector2d there = (T_c_p * match.on_print).hnormalized();
    return scene_.camera.focalLength() * (match.normalized - there).norm();
  }

  cv::Mat print_ = testing::poster(7);
  NaturalMarker marker_ = NaturalMarker::create(testing::viewOf(print_), kWidth_m, 0.0).value();
  testing::PictureScene scene_{.camera = CameraModel(testing::testCalibration())};
  PixelRays rays_{scene_.camera};
  Transform truth_ = testing::pictureAt(0.7, 0.4, 2.0, 0.1);
};

TEST_F(BlockMatchesTest, FindWhereThePictureReallyIs) {
  const cv::Mat image = seen(truth_);
  Vector6d off;
  off << 0.004, -0.003, 0.0, 0.0, 0.0, 0.01;  // some four pixels
  const Transform start = truth_.retract(off);
  const std::vector<PrintPoint> matches = match(image, start);
  ASSERT_GT(matches.size(), 100U);
  std::vector<double> errors;
  for (const PrintPoint& one : matches) errors.push_back(offBy_px(one, truth_));
  std::ranges::nth_element(errors, errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2));
  EXPECT_LT(errors[errors.size() / 2], 0.7);  // whole pixels
  const auto pose = poseFromPoints(start, matches, scene_.camera.focalLength(), 1.0);
  ASSERT_TRUE(pose);
  EXPECT_GT((start.p - truth_.p).norm(), 0.004);
  EXPECT_LT((pose->T.p - truth_.p).norm(), 0.002);
}

TEST_F(BlockMatchesTest, WhatHidesThePictureIsNoneOfItsBlocks) {
  cv::Mat image = seen(truth_);
  const std::size_t whole = match(image, truth_).size();
  // A cover that is shaded, over the left half.
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < 318; ++x) {
      image.at<std::uint8_t>(y, x) =
          static_cast<std::uint8_t>(130 + 30 * std::sin(0.11 * x) * std::sin(0.13 * y));
    }
  }
  int left = 0;
  int right = 0;
  for (const PrintPoint& one : match(image, truth_)) {
    const double x_px = scene_.camera.project(truth_ * one.on_print)->x();
    ++(x_px < 310.0 ? left : right);
  }
  EXPECT_GT(right, static_cast<int>(whole) / 3);
  EXPECT_LT(left, right / 4);
}

}  // namespace
}  // namespace waymark::slam
