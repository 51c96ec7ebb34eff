#include "slam/geometry/calibration_fit.h"

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

TEST(CalibrationFit, EqualSizesNeedNothing) {
  for (const auto fit : {CalibrationFit::kExact, CalibrationFit::kScale, CalibrationFit::kCrop}) {
    const auto fitted = fitCalibration(testing::testCalibration(), 640, 480, fit);
    ASSERT_TRUE(fitted) << fitted.error().message;
    EXPECT_EQ(fitted->calibration.cx, testing::testCalibration().cx);
    EXPECT_EQ(fitted->change, "");
  }
}

// A pixel of the small picture covers four of the large one: its centre is where they meet.
TEST(CalibrationFit, AScaledPictureShowsEveryPointWhereItsPixelsAre) {
  const CameraModel whole(testing::testCalibration());
  const auto fitted = fitCalibration(whole.calibration(), 320, 240, CalibrationFit::kScale);
  ASSERT_TRUE(fitted) << fitted.error().message;
  EXPECT_EQ(fitted->change, "scaled from 640x480 to 320x240");
  const CameraModel half(fitted->calibration);
  for (const Eigen::Vector2d& n : {Eigen::Vector2d(0.0, 0.0), Eigen::Vector2d(-0.5, 0.3)}) {
    const Eigen::Vector2d expected =
        (whole.distort(n) + Eigen::Vector2d(0.5, 0.5)) / 2.0 - Eigen::Vector2d(0.5, 0.5);
    EXPECT_LT((half.distort(n) - expected).norm(), 1e-9);
  }
}

TEST(CalibrationFit, RoundingMayCostAPixel) {
  Calibration c = testing::testCalibration();
  c.width = 1296;
  c.height = 730;
  EXPECT_TRUE(fitCalibration(c, 640, 360, CalibrationFit::kScale));  // 360.49
  EXPECT_FALSE(fitCalibration(c, 640, 362, CalibrationFit::kScale));
}

TEST(CalibrationFit, ACropLeavesPointsWhereTheyAre) {
  const CameraModel whole(testing::testCalibration());
  const auto fitted = fitCalibration(whole.calibration(), 640, 360, CalibrationFit::kCrop);
  ASSERT_TRUE(fitted) << fitted.error().message;
  EXPECT_EQ(fitted->change, "cropped from 640x480 to 640x360");
  const CameraModel middle(fitted->calibration);
  const Eigen::Vector2d n(-0.3, 0.1);
  EXPECT_LT((middle.distort(n) - whole.distort(n) + Eigen::Vector2d(0.0, 60.0)).norm(), 1e-9);
}

TEST(CalibrationFit, WhatIsRejectedSaysWhatWouldDo) {
  const auto complaint = [](int width, int height, CalibrationFit fit) {
    const auto fitted = fitCalibration(testing::testCalibration(), width, height, fit);
    return fitted ? "none" : fitted.error().message;
  };
  EXPECT_EQ(complaint(320, 240, CalibrationFit::kExact),
            "the pictures are 320x240, but the calibration is for 640x480; the calibration fit "
            "'scale' or 'crop' would take them");
  EXPECT_EQ(complaint(1280, 960, CalibrationFit::kCrop),
            "the pictures are 1280x960, but the calibration is for 640x480, which is no crop of "
            "it; the calibration fit 'scale' would take them");
  EXPECT_EQ(complaint(640, 361, CalibrationFit::kExact),
            "the pictures are 640x361, but the calibration is for 640x480");
  EXPECT_NE(complaint(640, 360, CalibrationFit::kScale)
                .find("no scale of it; the calibration fit "
                      "'crop'"),
            std::string::npos);
}

}  // namespace
}  // namespace waymark::slam
