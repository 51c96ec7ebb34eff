#include "slam/natural/filter/filter_state.h"

#include <random>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "slam/natural/filter/se3.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

using Vector12d = Eigen::Matrix<double, kMotionSize, 1>;
using Matrix12d = Eigen::Matrix<double, kMotionSize, kMotionSize>;

// A camera that moves and turns, far from the origin.
FilterState movingCamera() {
  FilterState state(6, 10);
  const Transform T = testing::lookAt({4.0, -2.0, 1.5}, {5.0, 3.0, 1.0});
  Matrix6d C = 1e-4 * Matrix6d::Identity();
  C(0, 4) = C(4, 0) = 3e-5;
  state.start(T, C, Matrix6d(0.25 * Matrix6d::Identity()));
  Vector12d motion = Vector12d::Zero();
  motion.tail<6>() << 0.4, -0.3, 0.2, 0.5, -0.8, 0.3;
  state.correct(motion.data());
  return state;
}

// The error of one state against another, in the filter's coordinates.
Vector12d difference(const FilterState& to, const FilterState& from) {
  Vector12d d;
  const Vector6d xi = logSe3(to.camera() * from.camera().inverse());
  const Eigen::Vector3d theta = xi.tail<3>();
  d.head<6>() = xi;
  d.segment<3>(6) =
      leftJacobianSo3(theta).inverse() * (to.velocity() - expSo3(theta) * from.velocity());
  d.tail<3>() = to.angularVelocity() - from.angularVelocity();
  return d;
}

TEST(FilterState, MotionJacobian) {
  const FilterState state = movingCamera();
  constexpr double kDt = 0.05;
  const Matrix12d F = state.motion(kDt, {}).F;
  FilterState mean = state;
  mean.propagate(kDt, {});
  constexpr double kStep = 1e-6;
  for (int i = 0; i < kMotionSize; ++i) {
    const Vector12d delta = kStep * Vector12d::Unit(i);
    const Vector12d negative = -delta;
    FilterState more = state;
    FilterState less = state;
    more.correct(delta.data());
    less.correct(negative.data());
    more.propagate(kDt, {});
    less.propagate(kDt, {});
    const Vector12d numeric = (difference(more, mean) - difference(less, mean)) / (2.0 * kStep);
    EXPECT_LT((F.col(i) - numeric).norm(), 1e-6 * (1.0 + numeric.norm())) << i;
  }
}

TEST(FilterState, CorrectionIsWhatItSays) {
  const FilterState state = movingCamera();
  std::mt19937 rng(1);
  std::normal_distribution<double> n(0.0, 0.3);
  for (int k = 0; k < 20; ++k) {
    Vector12d delta;
    for (int i = 0; i < kMotionSize; ++i) delta[i] = n(rng);
    FilterState moved = state;
    moved.correct(delta.data());
    EXPECT_LT((difference(moved, state) - delta).norm(), 1e-9);
  }
}

// The noise of two short steps is that of a long one.
TEST(FilterState, NoiseDoesNotDependOnTheFrameRate) {
  const FilterState state = movingCamera();
  FilterState once = state;
  once.propagate(0.1, {});
  FilterState often = state;
  for (int i = 0; i < 20; ++i) often.propagate(0.005, {});
  const Vector12d a = once.P().topLeftCorner<12, 12>().diagonal();
  const Vector12d b = often.P().topLeftCorner<12, 12>().diagonal();
  for (int i = 0; i < kMotionSize; ++i) EXPECT_NEAR(a[i], b[i], 0.03 * b[i]) << i;
}

// (dp, dtheta) as published, by drawing samples.
TEST(FilterState, PublishedCovarianceIsThatOfRetract) {
  const FilterState state = movingCamera();
  std::mt19937 rng(2);
  std::normal_distribution<double> n(0.0, 1.0);
  const Matrix6d L = Matrix6d(state.P<6, 6>(0, 0)).llt().matrixL();
  Matrix6d sum = Matrix6d::Zero();
  constexpr int kSamples = 20000;
  for (int k = 0; k < kSamples; ++k) {
    Vector6d unit;
    for (int i = 0; i < 6; ++i) unit[i] = n(rng);
    const Vector6d d = state.camera().localCoordinates(expSe3(Vector6d(L * unit)) * state.camera());
    sum += d * d.transpose();
  }
  sum /= kSamples;
  const Matrix6d published = state.poseCovariance();
  EXPECT_LT((sum - published).norm(), 0.05 * published.norm());
}

TEST(FilterState, ACloneIsTheCameraItWas) {
  FilterState state = movingCamera();
  const int place = state.clonePose(PoseKind::kPast, 17);
  ASSERT_GE(place, 0);
  const int at = state.poses()[static_cast<std::size_t>(place)].offset;
  EXPECT_EQ((state.P<6, 6>(at, at) - state.P<6, 6>(0, 0)).norm(), 0.0);
  EXPECT_EQ((state.P<6, 6>(at, 0) - state.P<6, 6>(0, 0)).norm(), 0.0);
  EXPECT_EQ(state.findPose(PoseKind::kPast, 17), place);
  EXPECT_FALSE(state.findPose(PoseKind::kMarker, 17));
  // A motion of the world takes both along.
  std::vector<double> delta(static_cast<std::size_t>(state.size()), 0.0);
  for (const int offset : {0, at}) {
    for (int i = 0; i < 6; ++i) delta[static_cast<std::size_t>(offset + i)] = 0.1 * (i + 1);
  }
  state.correct(delta.data());
  const Transform& past = state.poses()[static_cast<std::size_t>(place)].T_w_s;
  EXPECT_LT((past.p - state.camera().p).norm(), 1e-12);
  EXPECT_LT((past.R - state.camera().R).norm(), 1e-12);
}

TEST(FilterState, WhatIsRemovedLeavesTheRestAsItWas) {
  FilterState state = movingCamera();
  const int a = state.clonePose(PoseKind::kAnchor, 0);
  const int f = state.addFeature(a, {0.1, 0.2}, 0.5, 1e-3 * Eigen::Matrix3d::Identity());
  const int g = state.addFeature(a, {0.2, 0.2}, 0.5, 2e-3 * Eigen::Matrix3d::Identity());
  state.propagate(0.1, {});
  const int b = state.clonePose(PoseKind::kAnchor, 0);
  const int h = state.addFeature(b, {0.3, 0.2}, 0.5, 3e-3 * Eigen::Matrix3d::Identity());
  const auto pose = [&state](int i) { return state.poses()[static_cast<std::size_t>(i)].offset; };
  const auto feature = [&state](int i) {
    return state.features()[static_cast<std::size_t>(i)].offset;
  };
  const Matrix6d ab = state.P<6, 6>(pose(a), pose(b));
  const Matrix6d bb = state.P<6, 6>(pose(b), pose(b));
  state.removeFeature(f);
  state.compact();
  EXPECT_EQ(state.size(), kMotionSize + 2 * kPoseSize + 2 * kFeatureSize);
  EXPECT_EQ((state.P<6, 6>(pose(a), pose(b)) - ab).norm(), 0.0);
  EXPECT_EQ((state.P<3, 3>(feature(g), feature(g)) - 2e-3 * Eigen::Matrix3d::Identity()).norm(),
            0.0);
  EXPECT_EQ((state.P<3, 3>(feature(h), feature(h)) - 3e-3 * Eigen::Matrix3d::Identity()).norm(),
            0.0);
  state.removeFeature(g);
  state.removePose(a);
  state.compact();
  EXPECT_EQ((state.P<6, 6>(pose(b), pose(b)) - bb).norm(), 0.0);
  EXPECT_EQ(state.featureCount(), 1);
  EXPECT_EQ((state.P() - state.P().transpose()).norm(), 0.0);
  // Their places are free again.
  EXPECT_EQ(state.clonePose(PoseKind::kAnchor, 0), a);
}

TEST(FilterState, WithoutRoomThereIsNoPlace) {
  FilterState state(1, 1);
  state.start({}, Matrix6d::Identity(), Matrix6d::Identity());
  const int a = state.clonePose(PoseKind::kAnchor, 0);
  EXPECT_EQ(a, 0);
  EXPECT_EQ(state.clonePose(PoseKind::kAnchor, 0), -1);
  EXPECT_EQ(state.addFeature(a, {0, 0}, 0.5, Eigen::Matrix3d::Identity()), 0);
  EXPECT_EQ(state.addFeature(a, {0, 0}, 0.5, Eigen::Matrix3d::Identity()), -1);
}

// Another world: the same covariance of what has nothing to do with it.
TEST(FilterState, MovedWorld) {
  FilterState state = movingCamera();
  const int a = state.clonePose(PoseKind::kAnchor, 0);
  state.propagate(0.3, {});
  const auto relative = [&] {  // the camera as the anchor sees it
    const StatePose& pose = state.poses()[static_cast<std::size_t>(a)];
    const Matrix6d between = state.P<6, 6>(0, 0) + state.P<6, 6>(pose.offset, pose.offset) -
                             state.P<6, 6>(0, pose.offset) - state.P<6, 6>(pose.offset, 0);
    const Matrix6d A = adjoint(pose.T_w_s.inverse());
    return Matrix6d(A * between * A.transpose());
  };
  const Matrix6d before = relative();
  const Matrix6d published = state.poseCovariance();
  const Transform T_new_old{expSo3({0.5, -1.0, 2.0}), {3.0, 1.0, -2.0}};
  const Transform was = state.camera();
  const Eigen::Vector3d velocity = state.velocity();
  state.moveWorld(T_new_old);
  EXPECT_LT((state.camera().p - T_new_old * was.p).norm(), 1e-12);
  EXPECT_LT((state.velocity() - T_new_old.R * velocity).norm(), 1e-12);
  EXPECT_LT((relative() - before).norm(), 1e-9 * before.norm());
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = T_new_old.R;
  turn.bottomRightCorner<3, 3>() = T_new_old.R;
  EXPECT_LT((state.poseCovariance() - turn * published * turn.transpose()).norm(),
            1e-9 * published.norm());
}

// What is seen of a world is the same when all of it is larger, so that nothing measured changes;
// and the way to the past camera is as uncertain as the scale.
TEST(FilterState, ScaledItLooksTheSame) {
  FilterState state(4, 4);
  Matrix6d velocity = 0.04 * Matrix6d::Identity();
  Transform T_w_c;
  T_w_c.p = {3.0, -1.0, 0.5};
  state.start(T_w_c, 1e-4 * Matrix6d::Identity(), velocity);
  const int past = state.clonePose(PoseKind::kPast, 7);
  const int anchor = state.clonePose(PoseKind::kAnchor, 0);
  std::vector<double> moving(static_cast<std::size_t>(state.size()), 0.0);
  moving[6] = 0.4;   // xi_v
  moving[11] = 0.2;  // omega
  state.correct(moving.data());
  for (int i = 0; i < 10; ++i) state.propagate(0.05, {});
  const int feature =
      state.addFeature(anchor, {0.1, -0.2}, 0.5, 1e-3 * Eigen::Matrix3d::Identity());
  const auto seenFrom = [&] {
    const StateFeature& f = state.features()[static_cast<std::size_t>(feature)];
    const Transform& T_w_a = state.poses()[static_cast<std::size_t>(anchor)].T_w_s;
    const Eigen::Vector3d p_c =
        state.camera().inverse() * (T_w_a * (Eigen::Vector3d(f.uv.x(), f.uv.y(), 1.0) / f.rho));
    return Eigen::Vector2d(p_c.head<2>() / p_c.z());
  };
  const Eigen::Vector2d seen = seenFrom();
  const Transform T_w_p = state.poses()[static_cast<std::size_t>(past)].T_w_s;
  const Eigen::Vector3d way = state.camera().p - T_w_p.p;
  const Eigen::Vector3d v = state.velocity();
  const auto wayVariance = [&] {  // along the way, of the camera less the past one
    const int offset = state.poses()[static_cast<std::size_t>(past)].offset;
    const Matrix6d both = state.P<6, 6>(0, offset);
    const Matrix6d between =
        state.P<6, 6>(0, 0) + state.P<6, 6>(offset, offset) - both - both.transpose();
    const Matrix6d A = retractFromInvariant(state.camera().p);
    const Eigen::Vector3d along = way.normalized();
    return along.dot((A * between * A.transpose()).topLeftCorner<3, 3>() * along);
  };
  const double before = wayVariance();

  state.scaleAbout(past, 2.5, 0.1);
  EXPECT_LT((seenFrom() - seen).norm(), 1e-9);
  EXPECT_LT((state.camera().p - T_w_p.p - 2.5 * way).norm(), 1e-9);
  EXPECT_LT((state.poses()[static_cast<std::size_t>(past)].T_w_s.p - T_w_p.p).norm(), 1e-9);
  EXPECT_LT((state.velocity() - 2.5 * v).norm(), 1e-9);
  EXPECT_NEAR(state.features()[static_cast<std::size_t>(feature)].rho, 0.2, 1e-12);
  const double of_scale = 0.1 * 2.5 * way.norm();
  EXPECT_NEAR(wayVariance(), 2.5 * 2.5 * before + of_scale * of_scale, 1e-6 * before);
  const Eigen::MatrixXd P = state.P();
  EXPECT_LT((P - P.transpose()).norm(), 1e-9);
}

// The mean of four depths: each one's own error is halved by it, what they have in common is not.
TEST(FilterState, TellsHowWellTheScaleIsKnown) {
  FilterState state(2, 4);
  EXPECT_EQ(state.scaleSigma(), 0.0);
  state.start({}, 1e-4 * Matrix6d::Identity(), 1e-4 * Matrix6d::Identity());
  const int anchor = state.clonePose(PoseKind::kAnchor, 0);
  constexpr double kOwn = 0.04;  // a share of the depth
  for (const double rho : {0.2, 0.5, 0.5, 1.0}) {
    ASSERT_GE(state.addFeature(anchor, {0.1, -0.2}, rho,
                               featureCovariance(1e-6 * Eigen::Matrix2d::Identity(), kOwn * rho)),
              0);
  }
  EXPECT_NEAR(state.scaleSigma(), kOwn / 2, 1e-9);
  constexpr double kInCommon = 0.1;
  state.scaleAbout(anchor, 1.0, kInCommon);
  // As much is known of each, now that it is in doubt with the others.
  EXPECT_NEAR(state.scaleSigma(), std::hypot(kInCommon, kOwn / 2), 1e-9);
}

}  // namespace
}  // namespace waymark::slam
