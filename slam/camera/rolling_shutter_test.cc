#include "slam/camera/rolling_shutter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <random>

#include <gtest/gtest.h>

#include "slam/camera/readout_estimate.h"
#include "slam/camera/undistort_map.h"
#include "slam/geometry/twist.h"
#include "slam/map/map.h"
#include "slam/optimization/map_optimizer.h"
#include "slam/testing/rolling_views.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.12;
constexpr int kAll = 1000;  // keyframes
constexpr double kReadout_s = 0.02;

class RollingShutterTest : public ::testing::Test {
 protected:
  // A map of the truth, but with corners as the shutter skewed them.
  Map mapSeenRolling(double speed, double sigma_px) {
    Map map;
    for (const auto& marker : markers_) {
      map.addMarker(marker.id, kSize);
      map.place(marker.id, marker.T_w_m);
    }
    std::uniform_real_distribution<double> u(-speed, speed);
    for (int i = 0; i < 14; ++i) {
      Keyframe keyframe;
      keyframe.T_w_c = testing::lookAt({0.2 * i - 1.3, 0.3 * (i % 3), 0.15 * (i % 2)},
                                       {0.1 * i - 0.6, 3.0, 0.0});
      keyframe.twist << u(rng_), u(rng_), u(rng_), u(rng_), u(rng_), u(rng_);
      for (const auto& marker : markers_) {
        const auto seen = testing::observeRolling(camera_, keyframe.T_w_c, keyframe.twist, marker,
                                                  kSize, kReadout_s, sigma_px, &rng_);
        if (seen) keyframe.detections.push_back(*seen);
      }
      (void)map.addKeyframe(keyframe);
    }
    return map;
  }

  std::optional<ReadoutEstimate> estimate(const Map& map, double readout_s, int keyframes) {
    return runToCompletion([&](Budget* a) {
      return estimateReadout(map, options_, readout_s, camera_, keyframes, bundle_, a);
    });
  }

  std::mt19937 rng_{21};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(3, 5, 0.5, &rng_);
  MarkerOptions options_{.size_m = kSize};
  BundleOptions bundle_{.max_iterations = 30, .min_relative_decrease = 1e-8};
};

TEST(RollingShutter, ImageVelocityMatchesFiniteDifferences) {
  Twist twist;
  twist << 0.3, -0.2, 0.4, 0.5, -0.7, 0.6;
  const Eigen::Vector3d p_c(0.4, -0.3, 2.0);
  const auto imageAt = [&](double seconds) {
    return (movedOn(Transform{}, twist, seconds).inverse() * p_c).hnormalized().eval();
  };
  constexpr double kStep_s = 1e-5;
  const Eigen::Vector2d numeric = (imageAt(kStep_s) - imageAt(-kStep_s)) / (2.0 * kStep_s);
  EXPECT_LT((imageVelocity(p_c, twist) - numeric).norm(), 1e-8);
}

TEST_F(RollingShutterTest, CornersComeBackToTheMiddleRowsTime) {
  const Transform T_w_c = testing::lookAt({0.2, 0.3, -0.1}, {0.0, 3.0, 0.0});
  Twist twist;
  twist << 0.2, 0.1, -0.1, 0.3, 0.8, -0.2;
  double worst_skewed_px = 0.0;
  for (const auto& marker : markers_) {
    const auto truth = testing::observe(camera_, T_w_c, marker.id, marker.T_w_m, kSize, 0.0, &rng_);
    const auto seen =
        testing::observeRolling(camera_, T_w_c, twist, marker, kSize, kReadout_s, 0.0, &rng_);
    const auto depth_m = depthFromPose(T_w_c, marker.T_w_m, kSize);
    if (!truth || !seen || !depth_m) continue;
    const MarkerDetection corrected = atMidFrame(*seen, camera_, twist, *depth_m, kReadout_s);
    for (std::size_t k = 0; k < 4; ++k) {
      worst_skewed_px = std::max(worst_skewed_px, (seen->pixels[k] - truth->pixels[k]).norm());
      const double left = (corrected.normalized[k] - truth->normalized[k]).norm();
      EXPECT_LT(camera_.focalLength() * left, 0.1) << "marker " << marker.id;
      EXPECT_EQ(corrected.pixels[k], seen->pixels[k]);
    }
  }
  EXPECT_GT(worst_skewed_px, 1.0);  // there was something to correct
}

TEST_F(RollingShutterTest, AMarkersSizeTellsItsDepth) {
  const Transform T_w_c = testing::lookAt({0.0, 0.0, 0.0}, {0.0, 3.0, 0.0});
  const Transform T_w_m = testing::markerFacing({0.0, 3.0, 0.0}, {0.0, 0.0, 0.0});
  const auto seen = testing::observe(camera_, T_w_c, 0, T_w_m, kSize, 0.0, &rng_);
  ASSERT_TRUE(seen);
  EXPECT_NEAR(depthFromSize(*seen, kSize)[0], 3.0, 0.03);
}

TEST_F(RollingShutterTest, TheReadoutTimeIsFoundWithTheMap) {
  Map map = mapSeenRolling(0.6, 0.1);
  const auto found = estimate(map, 0.0, kAll);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->readout_s, kReadout_s, 4.0 * found->sigma_s);
  EXPECT_LT(found->sigma_s, 0.001);
  EXPECT_TRUE(believable(found->readout_s, found->sigma_s, 0.0, {}));
  // Corrected with what was found, nothing is left to find.
  undistortAgain(camera_, found->readout_s, &map);
  (void)optimizeGlobally(&map, options_, bundle_);
  const auto again = estimate(map, found->readout_s, kAll);
  ASSERT_TRUE(again);
  EXPECT_NEAR(again->readout_s, found->readout_s, found->sigma_s);
  EXPECT_FALSE(believable(again->readout_s, again->sigma_s, found->readout_s, {}));
}

// In a large map a part of it has to do.
TEST_F(RollingShutterTest, TheNewestKeyframesTellTheReadoutTime) {
  const Map map = mapSeenRolling(0.6, 0.1);
  const int most = static_cast<int>(map.keyframes().size()) / 2;
  const auto of_all = estimate(map, 0.0, kAll);
  const auto of_some = estimate(map, 0.0, most);
  ASSERT_TRUE(of_all && of_some);
  EXPECT_NEAR(of_some->readout_s, kReadout_s, 4.0 * of_some->sigma_s);
  EXPECT_GT(of_some->sigma_s, of_all->sigma_s);
}

TEST_F(RollingShutterTest, ACameraAtRestDoesNotInventOne) {
  const Map map = mapSeenRolling(0.0, 0.1);
  const auto found = estimate(map, 0.0, kAll);
  EXPECT_TRUE(!found || !believable(found->readout_s, found->sigma_s, 0.0, {}));
}

TEST(RollingShutter, ALittleChangeIsNotBelieved) {
  const auto believed = [](double change_sigmas, const RollingShutterOptions& options = {}) {
    constexpr double kSigma_s = 1e-4;
    return believable(kReadout_s + change_sigmas * kSigma_s, kSigma_s, kReadout_s, options);
  };
  EXPECT_FALSE(believed(1.5));
  EXPECT_TRUE(believed(2.5));
  RollingShutterOptions options;
  options.min_change_sigmas = 1.0;
  EXPECT_TRUE(believed(1.5, options));
}

// The corners are noisier along the motion, the more the further from the middle row, but not
// without bounds; and as before, up to the doubt's single precision, once the readout time is
// known.
TEST_F(RollingShutterTest, WhatIsNotKnownOfItIsNoise) {
  const Transform T_w_c = testing::lookAt({0.1, 0.0, 0.2}, {0.0, 3.0, 0.0});
  Twist twist;
  twist << 0.3, 0.1, 0.0, 0.05, 0.4, -0.1;
  int whole = 0;
  int bounded = 0;
  for (const auto& marker : markers_) {
    auto seen = testing::observe(camera_, T_w_c, marker.id, marker.T_w_m, kSize, 0.1, &rng_);
    if (!seen) continue;
    const MarkerDetection before = *seen;
    const double sigma = std::sqrt(0.5 * before.covariance[0].trace());
    for (const double sigma_s : {0.03, 0.003}) {  // each in place of the one before
      doubtReadout(camera_, T_w_c, twist, marker.T_w_m, kSize, sigma_s, &*seen);
      std::array<Eigen::Vector2d, 4> by;
      double largest = 0.0;
      for (std::size_t k = 0; k < 4; ++k) {
        const Eigen::Vector3d p_c = T_w_c.inverse() * (marker.T_w_m * markerCorners(kSize)[k]);
        by[k] =
            sigma_s * rowTime(seen->pixels[k].y(), camera_.height()) * imageVelocity(p_c, twist);
        largest = std::max(largest, by[k].norm());
      }
      const double share = largest < 0.5 * sigma ? 0.0 : std::min(1.0, 3.0 * sigma / largest);
      whole += share == 1.0 ? 1 : 0;
      bounded += share > 0.0 && share < 1.0 ? 1 : 0;
      for (std::size_t k = 0; k < 4; ++k) {
        const Eigen::Matrix2d added = seen->covariance[k] - before.covariance[k];
        const Eigen::Matrix2d expected = share * share * by[k] * by[k].transpose();
        EXPECT_LT((added - expected).norm(), 0.01 * sigma * sigma + 1e-3 * expected.norm());
        EXPECT_LT((seen->noise(k) - before.covariance[k]).norm(), 1e-4 * sigma * sigma);
      }
    }
    seen->trustReadout();
    EXPECT_FALSE(seen->isDoubted());
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_LT((seen->covariance[k] - before.covariance[k]).norm(), 1e-4 * sigma * sigma);
    }
  }
  EXPECT_GT(whole, 3);
  EXPECT_GT(bounded, 3);
}

TEST_F(RollingShutterTest, ADoubtWithinTheNoiseIsNone) {
  const Transform T_w_c = testing::lookAt({0.1, 0.0, 0.2}, {0.0, 3.0, 0.0});
  const auto& marker = markers_.front();
  const Twist still = Twist::Zero();
  Twist slow = Twist::Zero();
  slow[3] = 0.002;
  auto seen = testing::observe(camera_, T_w_c, marker.id, marker.T_w_m, kSize, 0.1, &rng_);
  ASSERT_TRUE(seen);
  for (const Twist& twist : {still, slow}) {
    doubtReadout(camera_, T_w_c, twist, marker.T_w_m, kSize, 0.015, &*seen);
    EXPECT_FALSE(seen->isDoubted());
  }
}

// The estimate that frees the readout time takes it for no noise: it is what is asked for.
TEST_F(RollingShutterTest, IsEstimatedAsWellFromCornersThatDoubtIt) {
  Map map = mapSeenRolling(0.6, 0.1);
  const auto sure = estimate(map, 0.0, kAll);
  const Map seen = map;
  for (const auto& [id, keyframe] : seen.keyframes()) doubtReadout(camera_, 0.015, id, &map);
  ASSERT_TRUE(map.keyframes().at(3).detections.front().isDoubted());
  const auto doubting = estimate(map, 0.0, kAll);
  ASSERT_TRUE(sure && doubting);
  EXPECT_NEAR(doubting->readout_s, sure->readout_s, 1e-6);
  EXPECT_NEAR(doubting->sigma_s, sure->sigma_s, 0.01 * sure->sigma_s);
}

}  // namespace
}  // namespace waymark::slam
