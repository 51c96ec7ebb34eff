#include "slam/camera/undistort_map.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

TEST(UndistortMap, CornersFollowThePixels) {
  std::mt19937 rng(2);
  const CameraModel camera(testing::testCalibration());
  const auto markers = testing::markerWall(1, 3, 0.5, &rng);
  const Transform view = testing::lookAt({0.0, 0.5, 0.0}, {0.0, 3.0, 0.0});
  Map map = testing::trueMap(camera, {&view, 1}, markers, 0.12, 0.1, &rng);
  ASSERT_EQ(map.keyframes().at(0).detections.size(), 3U);

  Calibration other = testing::testCalibration();
  other.fx = 600.0;
  other.distortion = {};
  undistortAgain(CameraModel(other), 0.0, &map);
  for (const MarkerDetection& detection : map.keyframes().at(0).detections) {
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_NEAR(detection.normalized[k].x(), (detection.pixels[k].x() - other.cx) / 600.0, 1e-9);
    }
  }

  // A lens that ends before the outer two markers, which stand some 100 pixels from the middle.
  other.distortion[0] = -12.0;
  undistortAgain(CameraModel(other), 0.0, &map);
  EXPECT_NE(map.keyframes().at(0).find(1), nullptr);
  EXPECT_EQ(map.keyframes().at(0).find(0), nullptr);
  EXPECT_TRUE(map.viewsOf(0).empty());
  EXPECT_TRUE(map.viewsOf(2).empty());
}

}  // namespace
}  // namespace waymark::slam
