#include "slam/marker_pose/square_pose.h"

#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "slam/testing/ceres_reference.h"
#include "slam/testing/numeric.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

using testing::lookAt;
using testing::markerFacing;
using testing::observe;

constexpr double kSize = 0.12;
constexpr double kNoKernel = std::numeric_limits<double>::infinity();

class SquarePoseTest : public ::testing::Test {
 protected:
  // A far marker with noise, turned away by some angle: both solutions are minima of their own.
  MarkerDetection ambiguousMarker() {
    std::uniform_real_distribution<double> u(-1.0, 1.0);
    const Eigen::Vector3d centre(0.5 * u(rng_), 3.0, 0.5 * u(rng_));
    const Transform T_w_m = markerFacing(centre, {2.5 * u(rng_), 0.0, 2.5 * u(rng_)});
    return observe(camera_, lookAt({0, 0, 0}, {0, 3, 0}), 0, T_w_m, kSize, 0.3, &rng_).value();
  }

  static BundleProblem problemOf(const MarkerDetection& detection, const Transform& T_c_m) {
    BundleProblem problem;
    problem.cameras = {{Transform{}, true}};
    problem.markers = {{T_c_m, false}};
    problem.marker_sizes_m = {kSize};
    problem.observations = {{0, 0, &detection}};
    return problem;
  }

  CameraModel camera_{testing::testCalibration()};
  std::mt19937 rng_{7};
};

TEST_F(SquarePoseTest, ExactCornersGiveTheExactPose) {
  for (const Eigen::Vector3d& eye :
       {Eigen::Vector3d(0.4, 0.0, 0.3), Eigen::Vector3d(-1.0, 1.5, 0.2),
        Eigen::Vector3d(0.0, 2.0, 1.0)}) {
    const Transform T_w_m = markerFacing({0.1, 3.0, 0.2}, {0.3, 0.0, 0.6});
    const Transform T_w_c = lookAt(eye, {0.0, 3.0, 0.1});
    const auto seen = observe(camera_, T_w_c, 0, T_w_m, 0.12, 0.0, &rng_);
    ASSERT_TRUE(seen);
    const auto pose = estimateSquarePose(*seen, 0.12, camera_.focalLength());
    ASSERT_TRUE(pose);
    const Transform truth = T_w_c.inverse() * T_w_m;
    EXPECT_LT((pose->T_c_m[0].p - truth.p).norm(), 1e-6);
    EXPECT_LT(rotationDistance(pose->T_c_m[0].R, truth.R), 1e-5);
    EXPECT_LE(pose->error[0], pose->error[1]);
    EXPECT_NEAR(pose->T_c_m[1].R.determinant(), 1.0, 1e-9);
  }
}

// The whitened error of both solutions is flat there, by central differences of Ceres' residuals.
TEST_F(SquarePoseTest, BothSolutionsAreMinima) {
  for (int i = 0; i < 20; ++i) {
    const MarkerDetection detection = ambiguousMarker();
    const auto pose = estimateSquarePose(detection, kSize, camera_.focalLength());
    ASSERT_TRUE(pose);
    for (std::size_t k = 0; k < 2; ++k) {
      const auto error = [&](const Transform& T) {
        return Eigen::Matrix<double, 1, 1>(
            testing::CeresBundle(problemOf(detection, T), kNoKernel).cost());
      };
      EXPECT_NEAR(error(pose->T_c_m[k])[0], pose->error[k], 1e-6 * pose->error[k] + 1e-9);
      const auto slope = testing::numericJacobian(pose->T_c_m[k], error, 1e-5);
      const auto elsewhere =
          testing::numericJacobian(testing::disturbed(pose->T_c_m[k], 1e-3, &rng_), error, 1e-5);
      EXPECT_LT(slope.norm(), 0.05 * elsewhere.norm()) << "trial " << i << ", solution " << k;
    }
  }
}

// Where both end up in one minimum, the second as it was found stands for the alternative.
TEST_F(SquarePoseTest, OneMinimumLeavesTheUnrefinedSolution) {
  for (int i = 0; i < 20; ++i) {
    const MarkerDetection detection = ambiguousMarker();
    const auto two = estimateSquarePose(detection, kSize, camera_.focalLength());
    const auto one = estimateSquarePose(detection, kSize, camera_.focalLength(),
                                        {.same_rotation_rad = 4.0});  // whatever they are
    ASSERT_TRUE(two && one);
    EXPECT_EQ(one->error[0], two->error[0]);
    EXPECT_GT(one->error[1], two->error[1]);
  }
}

TEST_F(SquarePoseTest, BothSolutionsAreWhatCeresFinds) {
  for (int i = 0; i < 20; ++i) {
    const MarkerDetection detection = ambiguousMarker();
    const auto pose = estimateSquarePose(detection, kSize, camera_.focalLength());
    ASSERT_TRUE(pose);
    for (std::size_t k = 0; k < 2; ++k) {
      const double optimum =
          testing::CeresBundle(problemOf(detection, pose->T_c_m[k]), kNoKernel).solve();
      EXPECT_NEAR(pose->error[k], optimum, 1e-3 * optimum) << "trial " << i << ", solution " << k;
    }
  }
}

TEST_F(SquarePoseTest, NearAndObliqueIsUnambiguousFarAndSmallIsNot) {
  const Transform T_w_m = markerFacing({0.0, 3.0, 0.0}, {2.0, 0.0, 0.0});
  const auto near =
      observe(camera_, lookAt({0.2, 2.3, 0.1}, {0, 3, 0}), 0, T_w_m, 0.12, 0.05, &rng_);
  const auto far =
      observe(camera_, lookAt({0.0, -4.0, 0.0}, {0, 3, 0}), 0, T_w_m, 0.12, 0.3, &rng_);
  ASSERT_TRUE(near && far);
  EXPECT_TRUE(estimateSquarePose(*near, 0.12, camera_.focalLength())->unambiguous(3.0));
  EXPECT_FALSE(estimateSquarePose(*far, 0.12, camera_.focalLength())->unambiguous(3.0));
}

// What passes for unambiguous at tau_e = 3 must hardly ever be the wrong solution.
TEST_F(SquarePoseTest, AnUnambiguousPoseIsTheRightOne) {
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  int unambiguous = 0;
  int wrong = 0;
  for (int i = 0; i < 2000; ++i) {
    const Transform T_w_m =
        markerFacing({u(rng_), 3.0, u(rng_)}, {2.5 * u(rng_), 0.0, 2.5 * u(rng_)});
    const Transform T_w_c = lookAt({u(rng_), u(rng_), u(rng_)}, T_w_m.p);
    const auto seen = observe(camera_, T_w_c, 0, T_w_m, 0.12, 0.1, &rng_);
    if (!seen) continue;
    const auto pose = estimateSquarePose(*seen, 0.12, camera_.focalLength());
    ASSERT_TRUE(pose);
    if (!pose->unambiguous(3.0)) continue;
    ++unambiguous;
    const Transform truth = T_w_c.inverse() * T_w_m;
    wrong +=
        rotationDistance(pose->T_c_m[0].R, truth.R) > rotationDistance(pose->T_c_m[1].R, truth.R)
            ? 1
            : 0;
  }
  EXPECT_GT(unambiguous, 500);
  EXPECT_LE(wrong, unambiguous / 200) << "of " << unambiguous;
}

TEST_F(SquarePoseTest, DegenerateCornersHaveNoPose) {
  MarkerDetection detection;
  detection.covariance.fill(1e-8 * Eigen::Matrix2d::Identity());
  detection.normalized.fill(Eigen::Vector2d(0.1, 0.1));  // all in one place
  EXPECT_FALSE(estimateSquarePose(detection, 0.1, 500.0));
  for (std::size_t k = 0; k < 4; ++k) {
    detection.normalized[k] = {0.05 * static_cast<double>(k), 0.0};  // on one line
  }
  EXPECT_FALSE(estimateSquarePose(detection, 0.1, 500.0));
}

}  // namespace
}  // namespace waymark::slam
