#include "slam/tracking/motion_model.h"

#include <cmath>
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

// What twistTo() does not see: half an interval of what the camera has been found to accelerate by.
TEST(MotionModel, LearnsHowFarTheVelocityIsFromItsMean) {
  MotionModelOptions options;
  options.acceleration_sigma = 5.0;
  options.angular_acceleration_sigma = 20.0;
  MotionModel model(options);
  const Matrix6d unknown = model.twistCovariance(0);
  EXPECT_EQ(unknown(0, 0), options.velocity_sigma * options.velocity_sigma) << "not even a mean";
  constexpr double kInterval_s = 0.05;
  const auto sway = [](double t) { return 0.02 * std::sin(4.0 * t); };
  Transform T;
  const auto drive = [&](int first, int last, bool swaying) {
    for (int i = first; i < last; ++i) {
      T.p.x() = 0.01 * i + (swaying ? sway(i * kInterval_s) : 0.0);
      model.update(T, Matrix6d::Zero(), i * 50 * kMs);
    }
  };
  drive(0, 2, false);
  EXPECT_NEAR(std::sqrt(model.twistCovariance(100 * kMs)(0, 0)), 0.5 * 5.0 * kInterval_s, 1e-12)
      << "as the options expect, until more is known";
  drive(2, 400, true);
  // rms of 0.02 * 16 sin(4 t)
  EXPECT_NEAR(std::sqrt(model.twistCovariance(400 * 50 * kMs)(0, 0)),
              0.5 * 0.02 * 16.0 / std::sqrt(2.0) * kInterval_s, 0.0015);
  drive(400, 800, false);
  EXPECT_LT(std::sqrt(model.twistCovariance(800 * 50 * kMs)(0, 0)), 1e-4) << "it goes on steadily";
  EXPECT_GT(model.twistCovariance(900 * 50 * kMs)(0, 0), 0.5) << "too long ago";
}

}  // namespace
}  // namespace waymark::slam
