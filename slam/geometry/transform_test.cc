#include "slam/geometry/transform.h"

#include <random>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

Vector6d randomDelta(std::mt19937& rng, double scale) {
  std::uniform_real_distribution<double> u(-scale, scale);
  Vector6d d;
  for (int i = 0; i < 6; ++i) d[i] = u(rng);
  return d;
}

TEST(Transform, InverseAndProductCancel) {
  std::mt19937 rng(1);
  for (int i = 0; i < 100; ++i) {
    const Transform T_a_b = Transform{}.retract(randomDelta(rng, 2.0));
    const Transform T_b_c = Transform{}.retract(randomDelta(rng, 2.0));
    const Eigen::Vector3d x = Eigen::Vector3d::Random();
    EXPECT_LT((T_a_b * (T_b_c * x) - (T_a_b * T_b_c) * x).norm(), 1e-12);
    EXPECT_LT((T_a_b.inverse() * (T_a_b * x) - x).norm(), 1e-12);
  }
}

TEST(Transform, RetractInvertsLocalCoordinates) {
  std::mt19937 rng(2);
  for (int i = 0; i < 100; ++i) {
    const Transform T = Transform{}.retract(randomDelta(rng, 2.0));
    const Vector6d d = randomDelta(rng, 1.0);
    EXPECT_LT((T.localCoordinates(T.retract(d)) - d).norm(), 1e-9);
  }
}

TEST(Transform, LogIsExactNearZeroAndNearPi) {
  for (const double angle : {0.0, 1e-12, 1e-7, 1e-4, 0.5, 3.0, 3.14159}) {
    const Eigen::Vector3d r = angle * Eigen::Vector3d(1.0, -2.0, 0.5).normalized();
    EXPECT_LT((logSo3(expSo3(r)) - r).norm(), 1e-9) << angle;
  }
}

TEST(Transform, QuaternionHasPositiveW) {
  const Transform T = Transform::fromQuaternion(Eigen::Quaterniond(-0.5, 0.5, 0.5, 0.5), {1, 2, 3});
  EXPECT_GT(T.quaternion().w(), 0.0);
  EXPECT_LT((T.quaternion().toRotationMatrix() - T.R).norm(), 1e-12);
}

}  // namespace
}  // namespace waymark::slam
