#include "daemon/publish/body_motion.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

using slam::Transform;
using slam::Vector6d;

constexpr double kRate_hz = 150.0;
constexpr double kSigma_m = 0.0005;
constexpr double kSigma_rad = 0.0005;

std::int64_t timeNs(int frame) { return static_cast<std::int64_t>(frame * 1e9 / kRate_hz); }

// `offset_m`: how far the map may be off, the same in every frame.
slam::PoseEstimate estimate(const Transform& T_w_c, double offset_m = 0.0) {
  slam::PoseEstimate pose;
  pose.T_w_c = T_w_c;
  pose.view_covariance.diagonal().head<3>().setConstant(kSigma_m * kSigma_m);
  pose.view_covariance.diagonal().tail<3>().setConstant(kSigma_rad * kSigma_rad);
  pose.covariance = pose.view_covariance;
  pose.covariance.diagonal().array() += offset_m * offset_m;
  return pose;
}

// On a circle of one metre, looking ahead: 0.8 m/s along its own x, 0.8 rad/s about its own z.
constexpr double kSpeed = 0.8;
Transform onCircle(double t_s) {
  const double angle = kSpeed * t_s;
  Transform T_w_b;
  T_w_b.R = slam::expSo3(Eigen::Vector3d(0.0, 0.0, angle));
  T_w_b.p = Eigen::Vector3d(std::sin(angle), 1.0 - std::cos(angle), 0.0);
  return T_w_b;
}

BodyMotion::Options mounted() {
  BodyMotion::Options options;
  options.T_b_c.R = slam::expSo3(Eigen::Vector3d(-1.2, 1.2, -1.2));
  options.T_b_c.p = {0.2, -0.1, 0.3};
  return options;
}

TEST(BodyMotion, TheBodyIsWhereTheMountingSays) {
  const BodyMotion::Options options = mounted();
  BodyMotion motion(options);
  const Transform T_w_b = onCircle(1.0);
  const BodyState state = motion.update(estimate(T_w_b * options.T_b_c), 0);
  EXPECT_LT((state.T_w_b.p - T_w_b.p).norm(), 1e-12);
  EXPECT_LT((state.T_w_b.R - T_w_b.R).norm(), 1e-12);
  EXPECT_EQ(state.velocity_b.norm(), 0.0) << "nothing to compare with yet";
}

TEST(BodyMotion, VelocitiesAreInTheBodyFrameAndLessNoisyThanDifferences) {
  const BodyMotion::Options options = mounted();
  BodyMotion motion(options);
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  double squared = 0.0;
  double squared_turn = 0.0;
  int count = 0;
  for (int frame = 0; frame < 600; ++frame) {
    Transform T_w_c = onCircle(frame / kRate_hz) * options.T_b_c;
    Vector6d noise;
    for (double& x : noise) x = kSigma_m * normal(random);
    const BodyState state = motion.update(estimate(T_w_c.retract(noise)), timeNs(frame));
    if (frame < 75) continue;
    squared += (state.velocity_b - Eigen::Vector3d(kSpeed, 0.0, 0.0)).squaredNorm() / 3.0;
    squared_turn += (state.rotation_rate_b - Eigen::Vector3d(0.0, 0.0, kSpeed)).squaredNorm() / 3.0;
    ++count;
  }
  const double difference = std::sqrt(2.0) * kSigma_m * kRate_hz;  // of two neighbours: 0.106 m/s
  EXPECT_LT(std::sqrt(squared / count), 0.35 * difference);
  EXPECT_LT(std::sqrt(squared_turn / count), 0.7 * difference);
}

TEST(BodyMotion, AJumpOfTheMapIsNoMotion) {
  BodyMotion motion({});
  BodyState state;
  for (int frame = 0; frame < 300; ++frame) {
    Transform T_w_c = onCircle(frame / kRate_hz);
    if (frame >= 150) T_w_c.p.y() += 0.05;
    state = motion.update(estimate(T_w_c), timeNs(frame));
    if (frame >= 50) {
      EXPECT_LT((state.velocity_b - Eigen::Vector3d(kSpeed, 0.0, 0.0)).norm(), 0.05) << frame;
    }
  }
  EXPECT_NEAR(state.T_w_b.p.y(), onCircle(299 / kRate_hz).p.y() + 0.05, 1e-12);
}

// A map that may be off by decimetres, but is so in every frame: motions and jumps are told apart
// as in an exact one.
TEST(BodyMotion, WhatTheMapDoesNotKnowOfItselfIsNoNoiseOfTheFrames) {
  BodyMotion exact({});
  BodyMotion uncertain({});
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  for (int frame = 0; frame < 300; ++frame) {
    Vector6d noise;
    for (double& x : noise) x = kSigma_m * normal(random);
    Transform T_w_c = onCircle(frame / kRate_hz).retract(noise);
    if (frame >= 150) T_w_c.p.y() += 0.05;  // a loop has closed
    const BodyState expected = exact.update(estimate(T_w_c), timeNs(frame));
    const BodyState state = uncertain.update(estimate(T_w_c, 0.2), timeNs(frame));
    ASSERT_EQ(state.velocity_b, expected.velocity_b) << frame;
    ASSERT_EQ(state.rotation_rate_b, expected.rotation_rate_b) << frame;
  }
}

// Two pieces of the map become one: the world is another one, the motion is not.
TEST(BodyMotion, InAnotherWorldItGoesOnAsItDid) {
  BodyMotion motion({});
  Transform T_v_w;
  T_v_w.R = Eigen::AngleAxisd(2.0, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T_v_w.p = {5.0, -3.0, 1.0};
  for (int frame = 0; frame < 300; ++frame) {
    slam::PoseEstimate pose = estimate(onCircle(frame / kRate_hz));
    pose.piece = 4;
    if (frame >= 150 && frame < 220) {
      pose.T_w_c = T_v_w * pose.T_w_c;
      pose.piece = 1;
    }
    if (frame == 150) motion.enterWorld(1, {slam::PieceEvent::Kind::kJoined, 4, 1, T_v_w, {}});
    if (frame == 220) motion.enterWorld(4, {slam::PieceEvent::Kind::kParted, 4, 1, T_v_w, {}});
    const BodyState state = motion.update(pose, timeNs(frame));
    if (frame < 50) continue;
    EXPECT_LT((state.velocity_b - Eigen::Vector3d(kSpeed, 0.0, 0.0)).norm(), 0.05) << frame;
  }
}

TEST(BodyMotion, InAPieceThatNobodyConnectedItStartsAnew) {
  BodyMotion motion({});
  for (int frame = 0; frame < 50; ++frame) {
    (void)motion.update(estimate(onCircle(frame / kRate_hz)), timeNs(frame));
  }
  slam::PoseEstimate pose = estimate(onCircle(50 / kRate_hz));
  pose.piece = 1;
  EXPECT_EQ(motion.update(pose, timeNs(50)).velocity_b.norm(), 0.0);
}

TEST(BodyMotion, AnUnexpectedMotionIsFollowedAllTheSame) {
  BodyMotion motion({});
  BodyState state;
  for (int frame = 0; frame < 200; ++frame) {
    Transform T_w_c;
    if (frame > 100) T_w_c.p.x() = 3.0 * (frame - 100) / kRate_hz;  // at once 3 m/s
    state = motion.update(estimate(T_w_c), timeNs(frame));
  }
  EXPECT_NEAR(state.velocity_b.x(), 3.0, 0.05);
}

TEST(BodyMotion, AfterALongGapItStartsAnew) {
  BodyMotion motion({});
  (void)motion.update(estimate(onCircle(0.0)), 0);
  EXPECT_GT(motion.update(estimate(onCircle(0.4)), 400'000'000).velocity_b.norm(), 0.5);
  EXPECT_EQ(motion.update(estimate(onCircle(2.0)), 2'000'000'000).velocity_b.norm(), 0.0);
  EXPECT_EQ(motion.update(estimate(onCircle(1.9)), 1'900'000'000).velocity_b.norm(), 0.0)
      << "nor backwards";
}

}  // namespace
}  // namespace waymark::daemon
