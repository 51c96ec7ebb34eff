#include "slam/tracking/frame_tracker.h"

#include <cmath>
#include <numbers>
#include <optional>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/slam.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize_m = 0.12;
constexpr double kSigma_px = 0.1;

// The first frame of a map of one marker, seen from nearly the front, again and again.
class FirstFrameOfOneMarkerTest : public ::testing::Test {
 protected:
  static constexpr int kRuns = 400;

  FirstFrameOfOneMarkerTest() {
    map_.addMarker(1, kSize_m);
    map_.place(1, T_w_m_);
    options_.markers.size_m = kSize_m;
    options_.mapping = false;
  }

  // From so far away and up to so far from the marker's normal.
  std::optional<PoseEstimate> look(double distance_m, double max_tilt_rad) {
    std::uniform_real_distribution<double> part(0.0, 1.0);
    const double tilt = max_tilt_rad * part(rng_);
    const double around = 2.0 * std::numbers::pi * part(rng_);
    const Eigen::Vector3d eye(distance_m * std::sin(tilt) * std::cos(around),
                              -distance_m * std::cos(tilt),
                              distance_m * std::sin(tilt) * std::sin(around));
    truth_ = testing::lookAt(eye, T_w_m_.p);
    const std::vector<MarkerDetection> seen = {
        *testing::observe(camera_, truth_, 1, T_w_m_, kSize_m, kSigma_px, &rng_)};
    Slam slam(camera_, *Dictionary::byName("4X4_50"), options_, map_);
    return slam.process({.time = {0, 0}, .detections = seen}).pose;
  }

  std::mt19937 rng_{5};
  CameraModel camera_{testing::testCalibration()};
  Transform T_w_m_ = testing::markerFacing(Eigen::Vector3d::Zero(), {0.0, -1.0, 0.0});
  Map map_;
  Options options_;
  Transform truth_;
};

// Its two poses are hardly apart: which of them it is need not be decided.
TEST_F(FirstFrameOfOneMarkerTest, NearAndFromTheFrontHasAPoseThatKnowsItsError) {
  int posed = 0;
  double nees = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    const auto pose = look(0.6, 0.1);
    if (!pose) continue;
    ++posed;
    EXPECT_LT((pose->T_w_c.p - truth_.p).norm(), 0.12) << run;
    const Vector6d error = pose->T_w_c.localCoordinates(truth_);
    nees += error.dot(pose->covariance.ldlt().solve(error));
  }
  EXPECT_GT(posed, kRuns * 9 / 10);
  nees /= posed;
  EXPECT_GT(nees, 2.0);
  EXPECT_LT(nees, 6.5);
}

TEST_F(FirstFrameOfOneMarkerTest, FarAwayAndFromTheFrontHasNone) {
  for (int run = 0; run < kRuns; ++run) EXPECT_FALSE(look(3.6, 0.1)) << run;
}

}  // namespace
}  // namespace waymark::slam
