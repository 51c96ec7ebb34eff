#include "slam/camera/camera_share.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/camera/rolling_shutter.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.15;

class CameraShareTest : public ::testing::Test {
 protected:
  // The pose as the wall shows it through another lens than the one that took it.
  PoseSolution solved(const CameraModel& lens) {
    for (MarkerDetection& detection : seen_) {
      EXPECT_TRUE(undistortCorners(lens, &detection));
    }
    known_ = testing::knownFrom(seen_, markers_, kSize);
    return *PoseOptimizer(lens.focalLength(), kAll).optimize(known_, T_w_c_);
  }
  [[nodiscard]] CameraModel moved(const IntrinsicVector& by) const {
    return CameraModel(truth_.withIntrinsics(truth_.intrinsics() + by));
  }

  // Nothing is gated or weighted down.
  static constexpr PoseOptimizerOptions kAll{
      .max_iterations = 50, .huber = 1e6, .marker_chi2 = 1e9};
  std::mt19937 rng_{8};
  CameraModel truth_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(2, 3, 0.5, &rng_);
  Transform T_w_c_ = testing::lookAt({0.3, 0.8, 0.2}, {0.0, 3.0, 0.0});
  std::vector<MarkerDetection> seen_ =
      testing::observeAll(truth_, T_w_c_, markers_, kSize, 0.0, &rng_);
  std::vector<KnownMarker> known_;
};

// Each of the intrinsics moved a little: the pose moves as the covariance of that alone says.
TEST_F(CameraShareTest, OfTheLensIsHowThePoseMovesWithIt) {
  ASSERT_GE(seen_.size(), 4U);
  const PoseSolution straight = solved(truth_);
  IntrinsicVector step;
  step << 0.1, 0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3;
  for (Eigen::Index i = 0; i < 9; ++i) {
    IntrinsicVector by = IntrinsicVector::Zero();
    by[i] = step[i];
    const Vector6d shift = straight.T_w_c.localCoordinates(solved(moved(by)).T_w_c);
    (void)solved(truth_);
    IntrinsicMatrix covariance = IntrinsicMatrix::Zero();
    covariance(i, i) = step[i] * step[i];
    const Matrix6d share = lensShare(straight, known_, truth_, covariance);
    EXPECT_LT((share - shift * shift.transpose()).norm(), 0.05 * share.norm()) << i;
  }
}

TEST_F(CameraShareTest, AKnownLensHasNone) {
  const PoseSolution straight = solved(truth_);
  EXPECT_TRUE(lensShare(straight, known_, truth_, IntrinsicMatrix::Zero()).isZero());
}

// Seen through a shutter that takes as long as it might: the pose moves as the share says.
TEST_F(CameraShareTest, OfTheReadoutIsHowThePoseMovesWithIt) {
  constexpr double kSigma_s = 0.002;
  Twist twist;
  twist << 0.4, -0.3, 0.2, 0.1, 0.3, -0.2;
  const PoseSolution straight = solved(truth_);
  const Matrix6d share = readoutShare(straight, known_, truth_, twist, kSigma_s);
  for (MarkerDetection& detection : seen_) {
    const auto depth_m =
        depthFromPose(T_w_c_, markers_[static_cast<std::size_t>(detection.id)].T_w_m, kSize);
    ASSERT_TRUE(depth_m);
    detection = atMidFrame(detection, truth_, twist, *depth_m, kSigma_s);
  }
  known_ = testing::knownFrom(seen_, markers_, kSize);
  const auto moved = PoseOptimizer(truth_.focalLength(), kAll).optimize(known_, T_w_c_);
  ASSERT_TRUE(moved);
  const Vector6d shift = straight.T_w_c.localCoordinates(moved->T_w_c);
  EXPECT_GT(shift.norm(), 1e-4);
  EXPECT_LT((share - shift * shift.transpose()).norm(), 0.05 * share.norm());
}

TEST_F(CameraShareTest, AKnownReadoutAndACameraAtRestHaveNone) {
  const PoseSolution straight = solved(truth_);
  EXPECT_TRUE(readoutShare(straight, known_, truth_, Twist::Ones(), 0.0).isZero());
  EXPECT_TRUE(readoutShare(straight, known_, truth_, Twist::Zero(), 0.01).isZero());
}

}  // namespace
}  // namespace waymark::slam
