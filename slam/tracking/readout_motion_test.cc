#include "slam/tracking/readout_motion.h"

#include <random>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include "slam/camera/rolling_shutter.h"
#include "slam/geometry/image_velocity.h"
#include "slam/testing/rolling_views.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

constexpr double kReadout_s = 0.02;
constexpr double kSize_m = 0.2;
constexpr double kSigma_px = 0.1;

TEST(ImageVelocity, IsLinearInTheTwist) {
  Twist twist;
  twist << 0.4, -0.3, 0.7, 0.2, -0.5, 0.9;
  const Eigen::Vector3d p_c(0.3, -0.2, 1.7);
  EXPECT_LT((imageVelocityJacobian(p_c) * twist - imageVelocity(p_c, twist)).norm(), 1e-15);
}

class ReadoutMotionTest : public ::testing::Test {
 protected:
  struct Frame {
    std::vector<MarkerDetection> seen, detections;
    std::vector<KnownMarker> known;
    PoseSolution solution;
  };

  // Of a camera in the room that moves with `twist`.
  void look(const Twist& twist, Frame* frame) {
    for (const auto& marker : markers_) {
      auto seen = testing::observeRolling(camera_, truth_, twist, marker, kSize_m, kReadout_s,
                                          kSigma_px, &rng_);
      if (!seen) continue;
      for (std::size_t k = 0; k < 4; ++k) {
        Eigen::Matrix2d D;
        (void)camera_.distort(seen->normalized[k], &D);
        seen->covariance[k] = kSigma_px * kSigma_px * (D.transpose() * D).inverse();
      }
      frame->seen.push_back(*seen);
    }
  }
  // The pose with the corners moved by this motion.
  void solve(const Twist& twist, Frame* frame) {
    frame->detections.clear();
    for (const MarkerDetection& seen : frame->seen) {
      const auto& marker = markers_[static_cast<std::size_t>(seen.id)];
      const auto moved = deskewed(seen, camera_, truth_, twist, marker.T_w_m, kSize_m, kReadout_s);
      ASSERT_TRUE(moved);
      frame->detections.push_back(*moved);
    }
    frame->known = knownMarkers(map_, frame->detections);
    const auto solution = PoseOptimizer(camera_.focalLength()).optimize(frame->known, truth_);
    ASSERT_TRUE(solution);
    frame->solution = *solution;
  }
  [[nodiscard]] double nees(const Frame& frame, const Matrix6d& more) const {
    const Vector6d error = frame.solution.T_w_c.localCoordinates(truth_);
    return error.dot((frame.solution.covariance + more).llt().solve(error));
  }
  Vector6d draw(const Vector6d& sigma) {
    std::normal_distribution<double> unit;
    Vector6d drawn;
    for (Eigen::Index i = 0; i < 6; ++i) drawn[i] = sigma[i] * unit(rng_);
    return drawn;
  }

  std::mt19937 rng_{11};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::roomMarkers(28, 2.5, &rng_);
  Transform truth_ = testing::roomView(0.8);
  Map map_ =
      testing::trueMap(camera_, testing::roomViews(0.0, 4.0, 16), markers_, kSize_m, 0.0, &rng_);
};

// The consistency test: what the camera does during the readout is known from the frames before
// with some error, and the pose says how far off that leaves it.
TEST_F(ReadoutMotionTest, ThePoseErrsAsItSays) {
  constexpr int kRuns = 400;
  Vector6d sigma;
  sigma << 0.1, 0.1, 0.1, 0.2, 0.2, 0.2;
  const Matrix6d covariance = sigma.cwiseAbs2().asDiagonal();
  double told = 0.0;
  double ignored = 0.0;
  double error_before = 0.0;
  double error_after = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    Twist expected;
    expected << 0.1, 0.05, -0.1, 0.1, 0.3, -0.05;
    const Twist twist = expected + draw(sigma);
    Frame frame;
    look(twist, &frame);
    ASSERT_GE(frame.seen.size(), 3U);
    solve(expected, &frame);
    ignored += nees(frame, Matrix6d::Zero()) / kRuns;
    error_before += (frame.solution.T_w_c.p - truth_.p).squaredNorm();
    const auto motion = estimateReadoutMotion(
        frame.solution, frame.known, {camera_, kReadout_s, expected}, {expected, covariance});
    ASSERT_TRUE(motion);
    solve(motion->twist, &frame);
    told += nees(frame, motion->of_pose) / kRuns;
    error_after += (frame.solution.T_w_c.p - truth_.p).squaredNorm();
  }
  EXPECT_NEAR(told, 6.0, 0.6);
  EXPECT_GT(ignored, 12.0) << "the motion's part of it is what this is about";
  EXPECT_LT(error_after, 0.7 * error_before) << "the rows tell, too";
}

// The corners were moved by another motion than the expected one.
TEST_F(ReadoutMotionTest, TheExpectedMotionNeedNotBeTheOneUsed) {
  Twist twist;
  twist << 0.3, 0.1, -0.2, 0.2, 0.8, -0.1;
  Frame frame;
  look(twist, &frame);
  const Twist used = Twist::Zero();
  solve(used, &frame);
  const Matrix6d sure = 1e-8 * Matrix6d::Identity();
  const auto motion = estimateReadoutMotion(frame.solution, frame.known,
                                            {camera_, kReadout_s, used}, {twist, sure});
  ASSERT_TRUE(motion);
  EXPECT_LT((motion->twist - twist).norm(), 1e-3);
  EXPECT_LT(motion->of_pose.norm(), 1e-6);
}

TEST_F(ReadoutMotionTest, WithoutCornersThereIsNone) {
  EXPECT_FALSE(estimateReadoutMotion({}, {}, {camera_, kReadout_s, Twist::Zero()},
                                     {Twist::Zero(), Matrix6d::Identity()}));
}

}  // namespace
}  // namespace waymark::slam
