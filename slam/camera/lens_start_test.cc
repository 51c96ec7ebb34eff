#include "slam/camera/lens_start.h"

#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.15;

CameraModel cameraOf(double focal_per_width, double k1) {
  Calibration c{.width = 640, .height = 480};
  c.fx = c.fy = focal_per_width * 640.0;
  c.cx = 322.0;
  c.cy = 236.0;
  c.distortion[0] = k1;
  return CameraModel(c);
}

class LensStartTest : public ::testing::Test {
 protected:
  // The wall from another place, as the guessed lens has it.
  std::vector<MarkerDetection> frame(const CameraModel& truth, int i) {
    const double near_m = 3.2 * truth.calibration().fx / 640.0;  // as large in the image with each
    const Eigen::Vector3d eye(0.3 * i - 0.5, 3.0 - near_m, 0.2 * (i % 2));
    auto seen = testing::observeAll(truth, testing::lookAt(eye, {0.1 * i, 3.0, 0.0}), markers_,
                                    kSize, 0.05, &rng_);
    for (MarkerDetection& detection : seen) (void)undistortCorners(guess_, &detection);
    return seen;
  }

  std::mt19937 rng_{3};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(3, 5, 0.5, &rng_);
  LensStartOptions options_;
  LensPrior prior_ = priorOfGuess({}, false, options_);
  CameraModel guess_ = guessedCamera(640, 480, {}, options_);
};

TEST_F(LensStartTest, FindsTheFocalLengthOfAnyUsualLens) {
  for (const double focal : {0.4, 0.6, 0.85, 1.2, 1.6}) {
    const CameraModel truth = cameraOf(focal, focal < 0.7 ? -0.08 : -0.05);
    LensStart start(guess_, prior_, {.size_m = kSize}, options_);
    std::optional<StartingLens> found;
    for (int i = 0; i < options_.frames && !found; ++i) found = start.process(frame(truth, i));
    ASSERT_TRUE(found) << focal;
    const double error = found->camera.calibration().fx / truth.calibration().fx - 1.0;
    EXPECT_LT(std::abs(error), 3.0 * found->focalShare()) << focal;
    EXPECT_LT(found->focalShare(), 0.2) << focal;
    // Of one that is wider than 90 degrees this may be left open.
    if (focal < 0.5) continue;
    EXPECT_EQ(found->camera.calibration().model, DistortionModel::kRational) << focal;
  }
}

TEST_F(LensStartTest, AFieldOfViewIsAHint) {
  const CameraModel said = guessedCamera(640, 480, 90.0, options_);
  EXPECT_NEAR(said.calibration().fx, 320.0, 1e-9);
  EXPECT_LT(priorOfGuess({}, true, options_).focal_share, prior_.focal_share);
}

TEST_F(LensStartTest, NothingIsSaidWithoutASquare) {
  LensStart start(guess_, prior_, {.size_m = kSize}, options_);
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(start.process({}));
}

// A far, frontal square tells nothing: the guess goes on, and is told to be one.
TEST_F(LensStartTest, WhatCannotBeKnownIsSaidToBeUnknown) {
  const CameraModel truth = cameraOf(0.7, 0.0);
  const Eigen::Vector3d centre(0.0, 3.0, 0.0);
  const std::vector<testing::SyntheticMarker> one = {
      {0, testing::markerFacing(centre, centre - Eigen::Vector3d::UnitY())}};
  LensStart start(guess_, prior_, {.size_m = kSize}, options_);
  std::optional<StartingLens> found;
  for (int i = 0; i < 3 * options_.frames && !found; ++i) {
    found = start.process(testing::observeAll(truth, testing::lookAt({0.0, 0.0, 0.0}, centre), one,
                                              kSize, 0.2, &rng_));
  }
  ASSERT_TRUE(found);
  EXPECT_GT(found->focalShare(), 0.1);
}

}  // namespace
}  // namespace waymark::slam
