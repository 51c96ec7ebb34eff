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

TEST(Rotations, SeriesAreAsExactAsTheLibrary) {
  std::mt19937 rng(4);
  std::normal_distribution<double> gauss;
  for (double angle = 1e-9; angle < 3.14; angle *= 1.02) {
    const Eigen::Vector3d axis = Eigen::Vector3d(gauss(rng), gauss(rng), gauss(rng)).normalized();
    const Eigen::Matrix3d R = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    EXPECT_LT((expSo3(angle * axis) - R).cwiseAbs().maxCoeff(), 1e-14) << angle;
    EXPECT_LT((logSo3(R) - angle * axis).norm(), 1e-14) << angle;
  }
  EXPECT_TRUE(expSo3({0.0, 0.0, 0.0}).isIdentity(0.0));
  EXPECT_LT((expSo3({0.0, 0.0, 1000.0}).topLeftCorner<2, 2>() -
             Eigen::Rotation2Dd(1000.0).toRotationMatrix())
                .norm(),
            1e-10)
      << "many turns";
}

}  // namespace
}  // namespace waymark::slam
