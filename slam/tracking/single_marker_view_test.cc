#include "slam/tracking/single_marker_view.h"

#include <random>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

// A camera 5 m from its marker, and the other pose, turned about the marker.
PoseOfTwo farCamera() {
  PoseOfTwo pose;
  pose.marker_w = {1.0, 2.0, 0.5};
  pose.T_w_c.p = pose.marker_w + Eigen::Vector3d(0.0, 0.0, 5.0);
  const Eigen::Matrix3d turn = expSo3({0.0, 0.8, 0.0});
  pose.other_T_w_c = {turn * pose.T_w_c.R, pose.marker_w + turn * (pose.T_w_c.p - pose.marker_w)};
  pose.barrier = 1e9;
  pose.log_odds = 8.0;
  pose.decided = true;
  return pose;
}

// Cameras that err by a turn about the marker, and hardly at all across it.
TEST(CoverOfOtherPoseTest, ReachesAlongTheArc) {
  constexpr double kTurn_rad = 0.08;
  constexpr double kAcross_m = 0.002;
  const PoseOfTwo pose = farCamera();
  const Eigen::Vector3d lever = pose.T_w_c.p - pose.marker_w;
  Eigen::Matrix<double, 6, 3> arc;  // (dp, dtheta) of a turn, to first order
  arc << -skew(lever), Eigen::Matrix3d::Identity();
  Matrix6d view = kTurn_rad * kTurn_rad * arc * arc.transpose();
  view.topLeftCorner<3, 3>() += kAcross_m * kAcross_m * Eigen::Matrix3d::Identity();

  std::mt19937 rng(3);
  std::normal_distribution<double> normal;
  const auto vector = [&] { return Eigen::Vector3d(normal(rng), normal(rng), normal(rng)); };
  const Matrix6d covered = view + coverOfOtherPose(pose, view);
  double linear_nees = 0.0;
  double nees = 0.0;
  constexpr int kRuns = 2000;
  for (int i = 0; i < kRuns; ++i) {
    const Eigen::Matrix3d turn = expSo3(Eigen::Vector3d(kTurn_rad * vector()));
    const Transform truth{turn * pose.T_w_c.R, pose.marker_w + turn * lever + kAcross_m * vector()};
    const Vector6d error = pose.T_w_c.localCoordinates(truth);
    linear_nees += error.dot(view.llt().solve(error)) / kRuns;
    nees += error.dot(covered.llt().solve(error)) / kRuns;
  }
  EXPECT_GT(linear_nees, 50.0);
  EXPECT_LT(nees, 6.5);
  EXPECT_GT(nees, 4.0);
}

TEST(CoverOfOtherPoseTest, ReachesToTheOtherPoseWhileNothingIsDecided) {
  PoseOfTwo pose = farCamera();
  const Matrix6d view = 1e-6 * Matrix6d::Identity();
  const auto spread_m2 = [&] {
    const Matrix6d cover = coverOfOtherPose(pose, view);
    return cover(0, 0) + cover(1, 1) + cover(2, 2);
  };
  EXPECT_LT(spread_m2(), 1e-6);
  pose.decided = false;
  pose.log_odds = 0.0;
  const double squared_m2 = (pose.T_w_c.p - pose.other_T_w_c.p).squaredNorm();
  EXPECT_NEAR(spread_m2(), 0.5 * squared_m2, 1e-6);
}

TEST(PoseOfTwoTest, ARefinedPoseIsTheNearerOfTheTwo) {
  const PoseOfTwo pose = farCamera();
  const auto nudged = [](const Transform& T) {
    return T.retract((Vector6d() << 0.0, 0.0, 0.0, 0.01, 0.0, 0.0).finished());
  };
  const PoseOfTwo same = pose.at(nudged(pose.T_w_c));
  EXPECT_TRUE(same.decided);
  EXPECT_EQ(same.log_odds, pose.log_odds);
  EXPECT_EQ(same.other_T_w_c.p, pose.other_T_w_c.p);
  const PoseOfTwo other = pose.at(nudged(pose.other_T_w_c));
  EXPECT_FALSE(other.decided);
  EXPECT_EQ(other.log_odds, -pose.log_odds);
  EXPECT_EQ(other.other_T_w_c.p, pose.T_w_c.p);
}

}  // namespace
}  // namespace waymark::slam
