#include "slam/camera/lens_optimizer.h"

#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/camera/undistort_map.h"
#include "slam/testing/scene.h"
#include "slam/testing/whole_map_fit.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.15;
const BundleOptions kToTheEnd{.max_iterations = 100, .min_relative_decrease = 1e-10};

// A walk along a wall of twelve markers, with a calibration that is some pixels off.
TEST(LensOptimizer, TheLensAndTheCornersFollow) {
  std::mt19937 rng(31);
  std::uniform_real_distribution<double> u(-0.6, 0.6);
  const CameraModel truth(testing::testCalibration());
  std::vector<Transform> views;
  std::vector<testing::SyntheticMarker> markers;
  for (int i = 0; i < 12; ++i) {
    const double x = 0.4 * i;
    views.push_back(
        testing::lookAt({x, 0.3 * (i % 3), 0.2 * (i % 2)}, {x + 0.1 * (i % 2), 2.0, 0.0}));
    const Eigen::Vector3d centre(x, 2.0, 0.2 * u(rng));
    markers.push_back(
        {i, testing::markerFacing(centre, centre + Eigen::Vector3d(u(rng), -1.0, u(rng)))});
  }
  Map map = testing::trueMap(truth, views, markers, kSize, 0.02, &rng);
  Calibration stale = truth.calibration();
  stale.fx += 4.0;
  stale.fy += 4.0;
  CameraModel lens(stale);
  undistortAgain(lens, 0.0, &map);
  const double before = testing::costOf(testing::wholeMapFit(map));
  const BundleSummary summary = optimizeGloballyWithIntrinsics(
      &map, {.size_m = kSize}, {lens.intrinsics(), IntrinsicPriors{}.covariance()}, 0.0, kToTheEnd,
      &lens);
  ASSERT_FALSE(summary.failed);
  EXPECT_LT(std::abs(lens.calibration().fx - truth.calibration().fx), 1.0);
  EXPECT_LT(std::abs(lens.calibration().fy - truth.calibration().fy), 1.0);
  EXPECT_LT(testing::costOf(testing::wholeMapFit(map)), 0.5 * before);
  const MarkerDetection& detection = map.keyframes().at(3).detections.front();
  EXPECT_LT((lens.project({detection.normalized[0].x(), detection.normalized[0].y(), 1.0}).value() -
             detection.pixels[0])
                .norm(),
            1e-6)
      << "the corners are undistorted by the new lens";
}

}  // namespace
}  // namespace waymark::slam
