#include "slam/tracking/motion_model.h"

#include <random>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr std::int64_t kMs = 1'000'000;

// Constant velocity in the camera frame: every step the same rigid motion.
TEST(MotionModel, PredictsConstantMotion) {
  MotionModel model;
  EXPECT_FALSE(model.predict(0));
  const Transform step{expSo3({0.01, 0.02, -0.01}), {0.01, 0.0, 0.02}};
  Transform T;
  for (int i = 0; i < 5; ++i) {
    model.update(T, Matrix6d::Zero(), i * 10 * kMs);
    T = T * step;
  }
  const auto next = model.predict(50 * kMs);
  ASSERT_TRUE(next);
  EXPECT_LT((next->T_w_c.p - T.p).norm(), 1e-9);
  EXPECT_LT(rotationDistance(next->T_w_c.R, T.R), 1e-7);
}

TEST(MotionModel, ForgetsWithTime) {
  MotionModel model;
  model.update(Transform{}, Matrix6d::Zero(), 0);
  Transform moved;
  moved.p.x() = 0.1;
  model.update(moved, Matrix6d::Zero(), 10 * kMs);
  EXPECT_NEAR(model.predict(20 * kMs)->T_w_c.p.x(), 0.2, 1e-12);
  EXPECT_NEAR(model.predict(510 * kMs)->T_w_c.p.x(), 0.1, 1e-12) << "too long to extrapolate";
  EXPECT_FALSE(model.predict(2000 * kMs)) << "too old to be a prior";
  EXPECT_FALSE(model.predict(0)) << "time does not run backwards";
}

TEST(MotionModel, ACorrectionIsNotMotion) {
  MotionModel model;
  model.update(Transform{}, Matrix6d::Zero(), 0);
  model.update(Transform{}, Matrix6d::Zero(), 10 * kMs);
  Transform corrected;
  corrected.p.y() = 0.5;
  model.correct(corrected);
  EXPECT_NEAR(model.predict(20 * kMs)->T_w_c.p.y(), 0.5, 1e-12);
}

// Poses with known noise along a motion of constant velocity, and one that speeds up within what
// the options expect: the prediction's errors are what its covariance says.
TEST(MotionModel, ItsCovarianceIsConsistent) {
  constexpr double kSigma_m = 0.004;
  constexpr double kSigma_rad = 0.003;
  constexpr double kInterval_s = 0.02;
  MotionModelOptions options;
  options.acceleration_sigma = 2.0;
  options.angular_acceleration_sigma = 3.0;
  std::mt19937 rng(7);
  std::normal_distribution<double> unit;
  const auto vector = [&](double sigma) {
    return Eigen::Vector3d(sigma * unit(rng), sigma * unit(rng), sigma * unit(rng));
  };
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal() << Eigen::Vector3d::Constant(kSigma_m * kSigma_m),
      Eigen::Vector3d::Constant(kSigma_rad * kSigma_rad);
  double nees = 0.0;
  constexpr int kRuns = 2000;
  for (int run = 0; run < kRuns; ++run) {
    const Eigen::Vector3d velocity = vector(1.0);
    const Eigen::Vector3d turn = vector(1.0);
    const Eigen::Vector3d acceleration = vector(options.acceleration_sigma);
    const Eigen::Vector3d spin_up = vector(options.angular_acceleration_sigma);
    // The true camera: it only moves straight and turns about its own axes, slowly enough that the
    // order of the turns does not matter.
    const auto truth = [&](double t) {
      return Transform{expSo3(turn * t + 0.5 * spin_up * t * t),
                       velocity * t + 0.5 * acceleration * t * t};
    };
    MotionModel model(options);
    for (const int i : {0, 1}) {
      Vector6d error;
      error << vector(kSigma_m), vector(kSigma_rad);
      model.update(truth(i * kInterval_s).retract(error), covariance, i * 20 * kMs);
    }
    const auto predicted = model.predict(40 * kMs);
    ASSERT_TRUE(predicted);
    const Transform expected = truth(2 * kInterval_s);
    Vector6d error;
    error << predicted->T_w_c.p - expected.p, logSo3(predicted->T_w_c.R * expected.R.transpose());
    nees += error.dot(predicted->covariance.ldlt().solve(error)) / kRuns;
  }
  // 95 % of the means of 2000 draws of chi-square with 6 degrees of freedom, and some room for what
  // is not linear.
  EXPECT_NEAR(nees, 6.0, 0.4);
}

}  // namespace
}  // namespace waymark::slam
