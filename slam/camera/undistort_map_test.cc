#include "slam/camera/undistort_map.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

// Three markers on a wall, seen once through the test's lens.
Map wallMap() {
  std::mt19937 rng(2);
  const auto markers = testing::markerWall(1, 3, 0.5, &rng);
  const Transform view = testing::lookAt({0.0, 0.5, 0.0}, {0.0, 3.0, 0.0});
  return testing::trueMap(CameraModel(testing::testCalibration()), {&view, 1}, markers, 0.12, 0.1,
                          &rng);
}

TEST(UndistortMap, CornersFollowThePixels) {
  Map map = wallMap();
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

// A map in a file has one camera: what was seen before the focus changed is what this one would
// have seen.
TEST(UndistortMap, SeenThroughOneLens) {
  const CameraModel before(testing::testCalibration());
  Map map = wallMap();
  const Map as_it_was = map;
  Calibration longer = testing::testCalibration();
  longer.fx *= 1.03;
  const CameraModel in_use(longer);
  LensKnowledge lens{.given = before};
  seeThroughOne(in_use, lens, &map);
  const auto pixelsOf = [](const Map& m) { return m.keyframes().at(0).detections.front().pixels; };
  EXPECT_EQ(pixelsOf(map), pixelsOf(as_it_was)) << "there has been one lens only";
  lens.earlier.push_back({before, map.keyframes().at(0).monotonic_ns + 1});
  seeThroughOne(in_use, lens, &map);
  EXPECT_NE(pixelsOf(map), pixelsOf(as_it_was));
  undistortAgain(in_use, 0.0, &map);
  for (const MarkerDetection& seen : map.keyframes().at(0).detections) {
    const MarkerDetection* const was = as_it_was.keyframes().at(0).find(seen.id);
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_LT((seen.normalized[k] - was->normalized[k]).norm(), 1e-9);
    }
  }
}

}  // namespace
}  // namespace waymark::slam
