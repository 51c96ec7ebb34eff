#include "slam/camera_pose/pose_optimizer.h"

#include <limits>
#include <random>
#include <span>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "slam/geometry/reprojection.h"
#include "slam/testing/ceres_reference.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.12;

class PoseOptimizerTest : public ::testing::Test {
 protected:
  std::vector<KnownMarker> known(const std::vector<MarkerDetection>& detections) {
    return testing::knownFrom(detections, markers_, kSize);
  }

  std::mt19937 rng_{3};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(3, 4, 0.5, &rng_);
  PoseOptimizer optimizer_{camera_.focalLength()};
  Transform truth_ = testing::lookAt({0.2, 0.3, -0.1}, {0.0, 3.0, 0.0});
  Transform guess_ =
      truth_.retract((Vector6d() << 0.05, -0.03, 0.04, 0.03, -0.02, 0.05).finished());
};

TEST(Reprojection, JacobiansMatchFiniteDifferences) {
  constexpr double kStep = 1e-6;
  const Transform T_w_c = testing::lookAt({0.2, 0.3, -0.1}, {0.1, 3.0, 0.2});
  const Transform T_w_m = testing::markerFacing({0.1, 3.0, 0.2}, {0.5, 0.0, 0.0});
  const Eigen::Vector3d corner(0.06, -0.06, 0.0);
  const auto project = [&](const Transform& c, const Transform& m) {
    Projection p{Eigen::Vector2d::Zero(), Matrix23d::Zero()};
    EXPECT_TRUE(projectPoint(c, m * corner, &p));
    return p.normalized;
  };
  Projection projection;
  ASSERT_TRUE(projectPoint(T_w_c, T_w_m * corner, &projection));
  const Matrix26d J_c = cameraJacobian(T_w_c, T_w_m * corner, projection.J_point);
  const Matrix26d J_m = markerJacobian(T_w_m, T_w_m * corner, projection.J_point);
  for (int k = 0; k < 6; ++k) {
    const Vector6d step = kStep * Vector6d::Unit(k);
    const Eigen::Vector2d by_camera =
        (project(T_w_c.retract(step), T_w_m) - project(T_w_c.retract(-step), T_w_m)) / (2 * kStep);
    const Eigen::Vector2d by_marker =
        (project(T_w_c, T_w_m.retract(step)) - project(T_w_c, T_w_m.retract(-step))) / (2 * kStep);
    EXPECT_LT((by_camera - J_c.col(k)).norm(), 1e-8);
    EXPECT_LT((by_marker - J_m.col(k)).norm(), 1e-8);
  }
}

TEST(Reprojection, WhiteningGivesUnitCovariance) {
  Eigen::Matrix2d covariance;
  covariance << 4e-6, 1.5e-6, 1.5e-6, 1e-6;
  const Eigen::Matrix2d W = whitening(covariance);
  EXPECT_LT((W * covariance * W.transpose() - Eigen::Matrix2d::Identity()).norm(), 1e-9);
}

TEST_F(PoseOptimizerTest, FindsTheExactPoseFromExactCorners) {
  const auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.0, &rng_);
  ASSERT_GE(detections.size(), 4U);
  const auto solution = optimizer_.optimize(known(detections), guess_);
  ASSERT_TRUE(solution);
  EXPECT_LT((solution->T_w_c.p - truth_.p).norm(), 1e-7);
  EXPECT_LT(rotationDistance(solution->T_w_c.R, truth_.R), 1e-7);
  EXPECT_EQ(solution->inliers, static_cast<int>(detections.size()));
  EXPECT_LT(solution->rms_px, 1e-4);
}

// Small kernel, so that many corners are beyond it; the covariances say twice the true noise, so
// that the frame's own noise stays 1 and no marker is left out.
TEST_F(PoseOptimizerTest, ReachesTheSameOptimumAsCeres) {
  constexpr double kHuber = 0.6;
  const PoseOptimizer optimizer(camera_.focalLength(), {.huber = kHuber, .marker_chi2 = 1e9});
  for (int trial = 0; trial < 5; ++trial) {
    auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.2, &rng_);
    BundleProblem problem;
    problem.cameras = {{guess_, false}};
    for (auto& detection : detections) {
      for (auto& covariance : detection.covariance) covariance *= 4.0;
      problem.observations.push_back({0, static_cast<int>(problem.markers.size()), &detection});
      problem.markers.push_back({markers_[static_cast<std::size_t>(detection.id)].T_w_m, true});
      problem.marker_sizes_m.push_back(kSize);
    }
    const auto solution = optimizer.optimize(known(detections), guess_);
    ASSERT_TRUE(solution);
    const double optimum = testing::CeresBundle(problem, kHuber).solve();
    problem.cameras[0].T = solution->T_w_c;
    const double ours = testing::CeresBundle(problem, kHuber).cost();
    EXPECT_NEAR(ours, optimum, 1e-3 * optimum);
    const double plain =
        testing::CeresBundle(problem, std::numeric_limits<double>::infinity()).cost();
    EXPECT_GT(plain, 1.02 * ours) << "the kernel has to matter here";
    EXPECT_NEAR(solution->chi2, plain, 1e-6 * plain);
  }
}

// The published covariance is honest: the normalized squared error averages 6 over many trials.
TEST_F(PoseOptimizerTest, CovarianceMatchesTheErrors) {
  constexpr int kTrials = 400;
  double sum = 0.0;
  for (int i = 0; i < kTrials; ++i) {
    const auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.2, &rng_);
    const auto solution = optimizer_.optimize(known(detections), guess_);
    ASSERT_TRUE(solution);
    const Vector6d error = solution->T_w_c.localCoordinates(truth_);
    sum += error.dot(solution->covariance.inverse() * error);
  }
  EXPECT_GT(sum / kTrials, 5.5);
  EXPECT_LT(sum / kTrials, 6.5);
}

TEST_F(PoseOptimizerTest, LeavesOutAMarkerThatMoved) {
  auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.05, &rng_);
  ASSERT_GE(detections.size(), 4U);
  markers_[static_cast<std::size_t>(detections[1].id)].T_w_m.p.x() += 0.05;
  const auto solution = optimizer_.optimize(known(detections), guess_);
  ASSERT_TRUE(solution);
  EXPECT_FALSE(solution->inlier[1]);
  EXPECT_EQ(solution->inliers, static_cast<int>(detections.size()) - 1);
  // Within the 99.9 % bound of its own covariance.
  const Vector6d error = solution->T_w_c.localCoordinates(truth_);
  EXPECT_LT(error.dot(solution->covariance.inverse() * error), 22.5);
}

// Too few markers, or too few that fit, do not say which one is wrong.
TEST_F(PoseOptimizerTest, LeavesOutNoneWhereNobodyKnowsWhich) {
  auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.05, &rng_);
  markers_[static_cast<std::size_t>(detections[1].id)].T_w_m.p.x() += 0.05;
  const int count = static_cast<int>(detections.size());
  const auto inliers = [&](const PoseOptimizerOptions& options) {
    const PoseOptimizer optimizer(camera_.focalLength(), options);
    const auto solution = optimizer.optimize(known(detections), guess_);
    EXPECT_TRUE(solution);
    return solution ? solution->inliers : 0;
  };
  EXPECT_EQ(inliers({.min_gated_markers = count}), count - 1);
  EXPECT_EQ(inliers({.min_gated_markers = count + 1}), count);
  EXPECT_EQ(inliers({.min_inlier_share = (count - 1.5) / count}), count - 1);
  EXPECT_EQ(inliers({.min_inlier_share = 1.0}), count);
}

// What the map does not know of its markers is in the pose's covariance, and a doubtful marker
// counts for little beside sure ones.
TEST_F(PoseOptimizerTest, DoubtfulMarkersCountForLittle) {
  const auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.0, &rng_);
  ASSERT_GE(detections.size(), 4U);
  auto markers = known(detections);  // one is 1 mm from where the map has it
  for (auto& corner : markers[0].corners_w) corner.x() += 0.001;
  const auto misled = optimizer_.optimize(markers, truth_);
  markers[0].covariance = 1e-4 * Matrix6d::Identity();  // 1 cm
  const auto warned = optimizer_.optimize(markers, truth_);
  ASSERT_TRUE(misled && warned);
  EXPECT_TRUE(misled->inlier[0]);
  EXPECT_LT((warned->T_w_c.p - truth_.p).norm(), 0.1 * (misled->T_w_c.p - truth_.p).norm());

  const auto sure = optimizer_.optimize(known(detections), truth_);
  for (auto& marker : markers) marker.covariance = 1e-4 * Matrix6d::Identity();
  const auto vague = optimizer_.optimize(markers, truth_);
  ASSERT_TRUE(sure && vague);
  EXPECT_GT(vague->covariance.trace(), 10.0 * sure->covariance.trace());
}

TEST_F(PoseOptimizerTest, HasNoAnswerToDegenerateInput) {
  EXPECT_FALSE(optimizer_.optimize({}, guess_));
  const auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.0, &rng_);
  // Looking away from everything.
  const Transform away = testing::lookAt({0.0, 0.0, 0.0}, {0.0, -3.0, 0.0});
  EXPECT_FALSE(optimizer_.optimize(known(detections), away));
  // All corners of the only marker in one place: the normal equations are singular.
  auto point = known(detections);
  point.resize(1);
  point[0].corners_w.fill({0.0, 3.0, 0.0});
  const auto solution = optimizer_.optimize(point, guess_);
  EXPECT_TRUE(!solution || solution->covariance.diagonal().maxCoeff() > 1.0);
}

}  // namespace
}  // namespace waymark::slam
