#include "slam/mapping/camera_doubt.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/camera_pose/pose_optimizer.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSide_m = 0.15;
constexpr double kSigma_px = 0.1;

// Two markers 3 m away and 1 m apart. The first one is known, and alone says where the camera is.
class CameraDoubtTest : public ::testing::Test {
 protected:
  // A camera near `view` and what it sees; its pose is as the first marker's corners have it.
  std::optional<Keyframe> keyframe() {
    Keyframe keyframe;
    const auto seen = testing::observeAll(camera_, view_, markers_, kSide_m, kSigma_px, &rng_);
    keyframe.detections = {seen.begin(), seen.end()};
    const auto known = testing::knownFrom(seen, markers_, kSide_m);
    const auto solution = PoseOptimizer(camera_.focalLength()).optimize({known.data(), 1}, view_);
    if (!solution) return std::nullopt;
    keyframe.T_w_c = solution->T_w_c;
    return keyframe;
  }

  std::mt19937 rng_{11};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = {
      {0, testing::markerFacing({-0.5, 3.0, 0.0}, {0.8, 1.0, 0.6})},
      {1, testing::markerFacing({0.5, 3.0, 0.2}, {0.2, 0.0, 0.4})}};
  Transform view_ = testing::lookAt({0.0, 0.0, 0.0}, {0.0, 3.0, 0.1});
  Map map_;
};

// Where the second marker is seen to be, and where the keyframe's camera would see it: as far apart
// as the covariances say, and much farther than the corners' alone.
TEST_F(CameraDoubtTest, IsAsLargeAsTheErrorsItCauses) {
  map_.addMarker(0, kSide_m);
  map_.place(0, markers_[0].T_w_m);
  double corners_only = 0.0;
  double with_doubt = 0.0;
  constexpr int kRuns = 200;
  for (int i = 0; i < kRuns; ++i) {
    const auto frame = keyframe();
    ASSERT_TRUE(frame);
    const MarkerDetection doubted = withCameraDoubt(*frame, 1, kSide_m, map_, 1.0);
    const Eigen::Vector3d corner = markers_[1].T_w_m * markerCorners(kSide_m)[0];
    const Eigen::Vector3d p_c = frame->T_w_c.inverse() * corner;
    const Eigen::Vector2d error = p_c.head<2>() / p_c.z() - doubted.normalized[0];
    corners_only += error.dot(frame->find(1)->covariance[0].inverse() * error) / kRuns;
    with_doubt += error.dot(doubted.covariance[0].inverse() * error) / kRuns;
  }
  EXPECT_GT(corners_only, 20.0) << "or there would be nothing to doubt";
  // Chi-square of 2: the mean of 200 is 2 within 0.6 at four sigmas; the rest is curvature.
  EXPECT_GT(with_doubt, 1.2);
  EXPECT_LT(with_doubt, 3.0);
}

TEST_F(CameraDoubtTest, ThereIsNoneToTellWhereNothingElseIsKnown) {
  const auto frame = keyframe();
  ASSERT_TRUE(frame);
  const MarkerDetection same = withCameraDoubt(*frame, 1, kSide_m, map_, 1.0);
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_EQ(same.covariance[k], frame->find(1)->covariance[k]);
  }
}

}  // namespace
}  // namespace waymark::slam
