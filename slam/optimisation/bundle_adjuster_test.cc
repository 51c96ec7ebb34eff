#include "slam/optimisation/bundle_adjuster.h"

#include <deque>
#include <random>

#include <Eigen/LU>
#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.12;

// Markers on a wall, cameras along it; every start pose a little off, the first camera right and
// fixed.
struct Scenario {
  explicit Scenario(int seed, double sigma_px, int cameras = 10)
      : rng(static_cast<unsigned>(seed)) {
    const auto markers = testing::markerWall(3, 4, 0.5, &rng);
    std::normal_distribution<double> noise(0.0, 0.02);
    const auto disturbed = [&](const Transform& T) {
      Vector6d d;
      for (int i = 0; i < 6; ++i) d[i] = noise(rng);
      return T.retract(d);
    };
    for (const auto& marker : markers) {
      true_markers.push_back(marker.T_w_m);
      problem.markers.push_back({disturbed(marker.T_w_m), false});
      problem.marker_sizes_m.push_back(kSize);
    }
    for (int c = 0; c < cameras; ++c) {
      const Transform T_w_c = testing::lookAt({0.25 * c - 1.1, 0.4 * (c % 3), 0.2 * (c % 2)},
                                              {0.1 * c - 0.5, 3.0, 0.0});
      true_cameras.push_back(T_w_c);
      problem.cameras.push_back({c == 0 ? T_w_c : disturbed(T_w_c), c == 0});
      for (const auto& marker : markers) {
        const auto seen =
            testing::observe(camera, T_w_c, marker.id, marker.T_w_m, kSize, sigma_px, &rng);
        if (!seen) continue;
        detections.push_back(*seen);
        problem.observations.push_back({c, marker.id, &detections.back()});
      }
    }
  }

  std::mt19937 rng;
  CameraModel camera{testing::testCalibration()};
  std::vector<Transform> true_cameras, true_markers;
  std::deque<MarkerDetection> detections;
  BundleProblem problem;
};

const BundleOptions kToTheEnd{
    .max_iterations = 100, .min_relative_decrease = 1e-10, .estimate_noise = false};

TEST(BundleAdjuster, ExactCornersGiveTheExactMap) {
  for (const int cameras : {6, 20}) {  // fewer and more than the 12 markers: both eliminations
    Scenario s(1, 0.0, cameras);
    const BundleSummary summary = adjustBundle(&s.problem, kToTheEnd);
    EXPECT_FALSE(summary.failed);
    EXPECT_LT(summary.final_cost, 1e-6);
    for (std::size_t m = 0; m < s.true_markers.size(); ++m) {
      EXPECT_LT((s.problem.markers[m].T.p - s.true_markers[m].p).norm(), 1e-5);
    }
    for (std::size_t c = 0; c < s.true_cameras.size(); ++c) {
      EXPECT_LT(rotationDistance(s.problem.cameras[c].T.R, s.true_cameras[c].R), 1e-5);
    }
  }
}

TEST(BundleAdjuster, FixedPosesStayBitIdentical) {
  Scenario s(2, 0.1);
  const Transform before = s.problem.cameras[0].T;
  (void)adjustBundle(&s.problem, kToTheEnd);
  EXPECT_EQ(before.R, s.problem.cameras[0].T.R);
  EXPECT_EQ(before.p, s.problem.cameras[0].T.p);
}

// The same problem for Ceres, by numeric differentiation of an independent residual.
struct CeresResidual {
  const MarkerDetection* detection;
  int corner;
  bool operator()(const double* camera, const double* marker, double* residual) const {
    const auto pose = [](const double* p) {
      return Transform{expSo3({p[3], p[4], p[5]}), {p[0], p[1], p[2]}};
    };
    const auto k = static_cast<std::size_t>(corner);
    const Eigen::Vector3d x = pose(camera).inverse() * (pose(marker) * markerCorners(kSize)[k]);
    const Eigen::Vector2d difference =
        Eigen::Vector2d(x.x() / x.z(), x.y() / x.z()) - detection->normalised[k];
    const Eigen::Matrix2d L = detection->covariance[k].inverse().llt().matrixU();
    Eigen::Map<Eigen::Vector2d>(residual, 2) = L * difference;
    return true;
  }
};

double ceresOptimum(const Scenario& s, double huber) {
  std::deque<std::array<double, 6>> blocks;
  const auto block = [&](const Transform& T) {
    const Eigen::Vector3d r = logSo3(T.R);
    blocks.push_back({T.p.x(), T.p.y(), T.p.z(), r.x(), r.y(), r.z()});
    return blocks.back().data();
  };
  std::vector<double*> cameras, markers;
  for (const auto& pose : s.problem.cameras) cameras.push_back(block(pose.T));
  for (const auto& pose : s.problem.markers) markers.push_back(block(pose.T));
  ceres::Problem problem;
  for (const auto& o : s.problem.observations) {
    for (int corner = 0; corner < 4; ++corner) {
      problem.AddResidualBlock(
          new ceres::NumericDiffCostFunction<CeresResidual, ceres::CENTRAL, 2, 6, 6>(
              new CeresResidual{o.detection, corner}),
          new ceres::HuberLoss(huber), cameras[static_cast<std::size_t>(o.camera)],
          markers[static_cast<std::size_t>(o.marker)]);
    }
  }
  problem.SetParameterBlockConstant(cameras[0]);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-12;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return 2.0 * summary.final_cost;  // Ceres halves
}

TEST(BundleAdjuster, ReachesTheSameOptimumAsCeres) {
  for (const int seed : {3, 4, 5}) {
    Scenario s(seed, 0.3);
    const double ceres_cost = ceresOptimum(s, kToTheEnd.huber);
    const BundleSummary summary = adjustBundle(&s.problem, kToTheEnd);
    EXPECT_LT(summary.final_cost, summary.initial_cost);
    EXPECT_NEAR(summary.final_cost, ceres_cost, 1e-3 * ceres_cost) << "seed " << seed;
  }
}

TEST(BundleAdjuster, OutliersDoNotMoveTheMap) {
  Scenario s(6, 0.05);
  for (std::size_t i = 5; i < s.detections.size(); i += 17) {
    for (auto& corner : s.detections[i].normalised) corner.x() += 10.0 / 520.0;  // 10 pixels
  }
  (void)adjustBundle(&s.problem, kToTheEnd);
  for (std::size_t m = 0; m < s.true_markers.size(); ++m) {
    EXPECT_LT((s.problem.markers[m].T.p - s.true_markers[m].p).norm(), 0.01);
  }
}

// Where the corners are worse than their covariances say, the kernel must widen with them, or all
// of them count as outliers.
TEST(BundleAdjuster, WidensItsKernelToTheNoise) {
  const auto rmsAfter = [](bool estimate) {
    double squared = 0.0;
    int count = 0;
    for (const int seed : {11, 12, 13}) {
      Scenario s(seed, 0.5);
      for (auto& detection : s.detections) {
        for (auto& covariance : detection.covariance) covariance *= 1.0 / 400.0;
      }
      BundleOptions options = kToTheEnd;
      options.estimate_noise = estimate;
      (void)adjustBundle(&s.problem, options);
      if (estimate) (void)adjustBundle(&s.problem, options);  // from the right residuals
      for (std::size_t m = 0; m < s.true_markers.size(); ++m) {
        squared += (s.problem.markers[m].T.p - s.true_markers[m].p).squaredNorm();
        ++count;
      }
    }
    return std::sqrt(squared / count);
  };
  EXPECT_LT(rmsAfter(true), rmsAfter(false));
}

TEST(BundleAdjuster, DegenerateProblemsDoNoHarm) {
  BundleProblem empty;
  EXPECT_EQ(adjustBundle(&empty).final_cost, 0.0);

  Scenario lonely(7, 0.05);  // a camera and a marker that nobody sees
  const Transform unseen = testing::lookAt({9.0, 9.0, 9.0}, {0.0, 0.0, 0.0});
  lonely.problem.cameras.push_back({unseen, false});
  lonely.problem.markers.push_back({unseen, false});
  lonely.problem.marker_sizes_m.push_back(kSize);
  const BundleSummary summary = adjustBundle(&lonely.problem, kToTheEnd);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
  EXPECT_LT((lonely.problem.cameras.back().T.p - unseen.p).norm(), 1e-9);

  Scenario floating(8, 0.05);  // no gauge
  floating.problem.cameras[0].fixed = false;
  const BundleSummary free_summary = adjustBundle(&floating.problem, kToTheEnd);
  EXPECT_LE(free_summary.final_cost, free_summary.initial_cost);
  EXPECT_TRUE(floating.problem.markers[0].T.p.allFinite());
}

}  // namespace
}  // namespace waymark::slam
