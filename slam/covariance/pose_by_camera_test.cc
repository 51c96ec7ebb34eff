#include "slam/covariance/pose_by_camera.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/camera/rolling_shutter.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.15;

class PoseByCameraTest : public ::testing::Test {
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
  CameraUncertainty uncertain_{.camera = &truth_};
};

// Each of the intrinsics moved a little.
TEST_F(PoseByCameraTest, OfTheLens) {
  ASSERT_GE(seen_.size(), 4U);
  const PoseSolution straight = solved(truth_);
  uncertain_.covariance.topLeftCorner<9, 9>().setIdentity();
  const PoseGlobalMatrix by_camera = poseByCamera(straight, known_, uncertain_, Twist::Ones(), 0);
  EXPECT_TRUE(by_camera.col(9).isZero(0.0)) << "a known readout time";
  IntrinsicVector step;
  step << 0.1, 0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3;
  for (Eigen::Index i = 0; i < 9; ++i) {
    IntrinsicVector by = IntrinsicVector::Zero();
    by[i] = step[i];
    const Vector6d shift = straight.T_w_c.localCoordinates(solved(moved(by)).T_w_c);
    EXPECT_GT(shift.norm(), 1e-6) << i;
    EXPECT_LT((step[i] * by_camera.col(i) - shift).norm(), 0.03 * shift.norm()) << i;
  }
}

// Before the lens was changed, it was another one, of which these parameters say nothing.
TEST_F(PoseByCameraTest, NotOfFramesBeforeTheLensChanged) {
  const PoseSolution straight = solved(truth_);
  uncertain_.covariance.setIdentity();
  uncertain_.since_ns = 100;
  const PoseGlobalMatrix before = poseByCamera(straight, known_, uncertain_, Twist::Ones(), 99);
  EXPECT_TRUE(before.leftCols<9>().isZero(0.0));
  EXPECT_FALSE(before.col(9).isZero(0.0));
  const PoseGlobalMatrix since = poseByCamera(straight, known_, uncertain_, Twist::Ones(), 100);
  EXPECT_FALSE(since.leftCols<9>().isZero(0.0));
}

// Seen through a shutter that takes a little longer.
TEST_F(PoseByCameraTest, OfTheReadoutTime) {
  constexpr double kLonger_s = 0.002;
  Twist twist;
  twist << 0.4, -0.3, 0.2, 0.1, 0.3, -0.2;
  const PoseSolution straight = solved(truth_);
  uncertain_.covariance(9, 9) = 1.0;
  const PoseGlobalMatrix by_camera = poseByCamera(straight, known_, uncertain_, twist, 0);
  EXPECT_TRUE(by_camera.leftCols<9>().isZero(0.0)) << "a known lens";
  for (MarkerDetection& detection : seen_) {
    const auto depth_m =
        depthFromPose(T_w_c_, markers_[static_cast<std::size_t>(detection.id)].T_w_m, kSize);
    ASSERT_TRUE(depth_m);
    detection = atMidFrame(detection, truth_, twist, *depth_m, kLonger_s);
  }
  known_ = testing::knownFrom(seen_, markers_, kSize);
  const auto moved = PoseOptimizer(truth_.focalLength(), kAll).optimize(known_, T_w_c_);
  ASSERT_TRUE(moved);
  const Vector6d shift = straight.T_w_c.localCoordinates(moved->T_w_c);
  EXPECT_GT(shift.norm(), 1e-4);
  EXPECT_LT((kLonger_s * by_camera.col(9) - shift).norm(), 0.03 * shift.norm());
}

// A first order sees one way that all poses of a focal length lie on; at a tenth of it they are a
// tenth of that way beside it, at a thousandth nowhere else.
TEST_F(PoseByCameraTest, BesideTheFirstOrderIsWhatIsNotLinear) {
  PoseGlobalMatrix by_camera = PoseGlobalMatrix::Zero();
  by_camera.col(0) << 0.3, 0.0, 0.0, 0.0, 0.1, 0.0;
  const double fx = truth_.calibration().fx;
  for (const double share : {0.001, 0.1, 0.5}) {
    uncertain_.covariance(0, 0) = share * share * fx * fx;
    const Matrix6d covariance = covarianceByCamera(uncertain_, by_camera);
    const double along = 0.3 * share * fx;
    EXPECT_NEAR(std::sqrt(covariance(1, 1)), share * along / std::sqrt(3.0), 1e-9 * along);
    EXPECT_NEAR(covariance(1, 1), covariance(2, 2), 1e-12 * along);
    EXPECT_NEAR(std::sqrt(covariance(0, 0)), along * std::sqrt(1.0 + share * share / 3.0),
                1e-9 * along);
    EXPECT_NEAR(std::sqrt(covariance(3, 3)), share * 0.1 * share * fx / std::sqrt(3.0),
                1e-9 * along);
  }
  uncertain_.covariance.setZero();
  EXPECT_TRUE(covarianceByCamera(uncertain_, by_camera).isZero(0.0));
}

TEST_F(PoseByCameraTest, AKnownCameraMovesNothing) {
  const PoseSolution straight = solved(truth_);
  EXPECT_TRUE(poseByCamera(straight, known_, uncertain_, Twist::Ones(), 0).isZero(0.0));
  uncertain_.covariance(9, 9) = 1.0;
  EXPECT_TRUE(poseByCamera(straight, known_, uncertain_, Twist::Zero(), 0).isZero(0.0))
      << "nor does a shutter that reads a camera at rest";
}

}  // namespace
}  // namespace waymark::slam
