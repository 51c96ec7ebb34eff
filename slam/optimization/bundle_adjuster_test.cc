#include "slam/optimization/bundle_adjuster.h"

#include <gtest/gtest.h>

#include "slam/testing/bundle_scenario.h"
#include "slam/testing/ceres_reference.h"

namespace waymark::slam {
namespace {

using Scenario = testing::BundleScenario;
constexpr double kSize = Scenario::kSizeM;

const BundleOptions kToTheEnd{
    .max_iterations = 100, .min_relative_decrease = 1e-10, .estimate_residual_sigma = false};

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

TEST(BundleAdjuster, ReachesTheSameOptimumAsCeres) {
  for (const unsigned seed : {3U, 4U, 5U}) {
    Scenario s(seed, 0.3);
    const double ceres_cost = testing::CeresBundle(s.problem, kToTheEnd.huber).solve();
    const BundleSummary summary = adjustBundle(&s.problem, kToTheEnd);
    EXPECT_LT(summary.final_cost, summary.initial_cost);
    EXPECT_NEAR(summary.final_cost, ceres_cost, 1e-3 * ceres_cost) << "seed " << seed;
  }
}

// Eq. 41: with a wide prior and exact corners, the lens that took the pictures comes out.
TEST(BundleAdjuster, ExactCornersGiveTheExactLens) {
  for (const int cameras : {8, 20}) {  // both eliminations
    Scenario s(21, 0.0, cameras);
    IntrinsicVector sigma = 1000.0 * testing::lensSigma();
    s.disturbLens(testing::staleLens(), sigma);
    const BundleSummary summary = adjustBundle(&s.problem, kToTheEnd);
    EXPECT_FALSE(summary.failed);
    // The prior's pull: (off / sigma)^2 summed up is some 1e-6 of cost, and no more.
    const double pull = testing::staleLens().head<8>().cwiseQuotient(sigma.head<8>()).squaredNorm();
    EXPECT_LT(summary.final_cost, 1.01 * pull + 1e-9);
    const IntrinsicVector error = s.problem.lens->camera.intrinsics() - s.camera.intrinsics();
    EXPECT_LT(error.head<4>().cwiseAbs().maxCoeff(), 0.01) << error.transpose();
    EXPECT_LT(error.tail<5>().cwiseAbs().maxCoeff(), 1e-4) << error.transpose();
    for (std::size_t m = 0; m < s.true_markers.size(); ++m) {
      EXPECT_LT((s.problem.markers[m].T.p - s.true_markers[m].p).norm(), 1e-4);
    }
  }
}

// With noise the lens gets better, not exact, and what is held stays bit for bit what it was.
TEST(BundleAdjuster, NoisyCornersImproveTheLens) {
  Scenario s(22, 0.02, 20);
  IntrinsicVector sigma = testing::lensSigma();
  sigma[2] = sigma[3] = 0.0;  // the principal point is held
  IntrinsicVector off = testing::staleLens();
  off[2] = off[3] = 0.0;
  s.disturbLens(off, sigma);
  (void)adjustBundle(&s.problem, kToTheEnd);
  const IntrinsicVector found = s.problem.lens->camera.intrinsics();
  const IntrinsicVector error = found - s.camera.intrinsics();
  EXPECT_LT(std::abs(error[0]), 0.2 * off[0]);
  EXPECT_LT(std::abs(error[1]), 0.2 * off[1]);
  EXPECT_LT(std::abs(error[4]), 0.5 * off[4]);
  EXPECT_NEAR(found[2], s.problem.lens->expected[2], 1e-6);
  EXPECT_NEAR(found[3], s.problem.lens->expected[3], 1e-6);
  EXPECT_NEAR(found[8], 0.0, 1e-9) << "k3 has no sigma";
}

TEST(BundleAdjuster, WithALensReachesTheSameOptimumAsCeres) {
  for (const unsigned seed : {23U, 24U}) {
    Scenario s(seed, 0.3, 6, 2, 3);
    s.disturbLens(testing::staleLens(), testing::lensSigma());
    s.anchor(1, Vector6d::Constant(0.002), 0.001, 0.005);
    testing::CeresBundle reference(s.problem, kToTheEnd.huber);
    const double initial = reference.cost();
    const double optimum = reference.solve();
    const BundleSummary summary = adjustBundle(&s.problem, kToTheEnd);
    EXPECT_NEAR(summary.initial_cost, initial, 1e-6 * initial);
    EXPECT_NEAR(summary.final_cost, optimum, 1e-3 * optimum) << "seed " << seed;
  }
}

// Anchors instead of a fixed camera: they fix the world, and what they say counts as they are sure.
TEST(BundleAdjuster, AnchorsHoldTheWorld) {
  Scenario s(25, 0.0);
  s.problem.cameras[0].fixed = false;
  for (const int marker : {0, 3, 8, 11}) s.anchor(marker, Vector6d::Zero(), 0.001, 0.005);
  const BundleSummary summary = adjustBundle(&s.problem, kToTheEnd);
  EXPECT_FALSE(summary.failed);
  EXPECT_LT(summary.final_cost, 1e-6);
  for (std::size_t m = 0; m < s.true_markers.size(); ++m) {
    EXPECT_LT((s.problem.markers[m].T.p - s.true_markers[m].p).norm(), 1e-5);
  }
}

TEST(BundleAdjuster, WithAnchorsReachesTheSameOptimumAsCeres) {
  for (const unsigned seed : {26U, 27U}) {
    Scenario s(seed, 0.3);
    s.problem.cameras[0].fixed = false;
    // Surveys that contradict each other and the corners by several sigmas.
    std::normal_distribution<double> off(0.0, 0.005);
    for (const int marker : {0, 3, 8, 11}) {
      s.anchor(marker, Vector6d::NullaryExpr([&] { return off(s.rng); }), 0.001, 0.005);
    }
    const double optimum = testing::CeresBundle(s.problem, kToTheEnd.huber).solve();
    const BundleSummary summary = adjustBundle(&s.problem, kToTheEnd);
    EXPECT_NEAR(summary.final_cost, optimum, 1e-3 * optimum) << "seed " << seed;
  }
}

// Given the cameras, the normalized squared error of a marker averages its 6 unknowns.
TEST(BundleAdjuster, MarkerCovariancesAreHonest) {
  double sum = 0.0;
  int count = 0;
  for (unsigned seed = 100; seed < 140; ++seed) {
    Scenario s(seed, 0.2);
    for (std::size_t c = 0; c < s.true_cameras.size(); ++c) {
      s.problem.cameras[c] = {s.true_cameras[c], true};
    }
    BundleOptions options = kToTheEnd;
    options.huber = 1e9;
    BundleAdjuster adjuster(s.problem, options);
    (void)runToCompletion([&](Budget* a) { return adjuster.run(a); });
    for (std::size_t m = 0; m < s.true_markers.size(); ++m) {
      const Matrix6d covariance = adjuster.markerCovariance(static_cast<int>(m));
      const Vector6d error = adjuster.problem().markers[m].T.localCoordinates(s.true_markers[m]);
      sum += error.dot(covariance.ldlt().solve(error));
      ++count;
    }
  }
  // 480 markers: chi-square of 2880 degrees of freedom, whose deviation is 0.16 of the mean 6.
  EXPECT_NEAR(sum / count, 6.0, 5 * 0.16);
}

TEST(BundleAdjuster, OutliersDoNotMoveTheMap) {
  Scenario s(6, 0.05);
  for (std::size_t i = 5; i < s.detections.size(); i += 17) {
    for (auto& corner : s.detections[i].normalized) corner.x() += 10.0 / 520.0;  // 10 pixels
  }
  (void)adjustBundle(&s.problem, kToTheEnd);
  for (std::size_t m = 0; m < s.true_markers.size(); ++m) {
    EXPECT_LT((s.problem.markers[m].T.p - s.true_markers[m].p).norm(), 0.01);
  }
}

// Huber's kernel alone lets gross errors pull a little; behind the gate the map is, to rounding,
// the one without them.
TEST(BundleAdjuster, OutlierViewsTakeNoPart) {
  Scenario s(6, 0.05);
  Scenario clean(6, 0.05);
  std::vector<BundleProblem::Observation> good;
  int outliers = 0;
  for (std::size_t i = 0; i < s.detections.size(); ++i) {
    if (i % 17 == 5) {
      for (auto& corner : s.detections[i].normalized) corner.x() += 10.0 / 520.0;  // 10 pixels
      ++outliers;
    } else {
      good.push_back(clean.problem.observations[i]);
    }
  }
  clean.problem.observations = good;
  const auto furthest = [&](double view_chi2) {
    BundleProblem problem = s.problem;
    BundleOptions options = kToTheEnd;
    options.view_chi2 = view_chi2;
    const BundleSummary summary = adjustBundle(&problem, options);
    EXPECT_EQ(summary.gated_views, view_chi2 > 0.0 ? outliers : 0);
    double largest_m = 0.0;
    for (std::size_t m = 0; m < problem.markers.size(); ++m) {
      const double apart_m = (problem.markers[m].T.p - clean.problem.markers[m].T.p).norm();
      largest_m = std::max(largest_m, apart_m);
    }
    return largest_m;
  };
  ASSERT_EQ(adjustBundle(&clean.problem, kToTheEnd).gated_views, 0);
  ASSERT_GT(outliers, 3);
  EXPECT_LT(furthest(kToTheEnd.view_chi2), 1e-6);
  EXPECT_GT(furthest(0.0), 1e-4);
}

TEST(BundleAdjuster, TheGateComesWhenItIsTold) {
  Scenario s(6, 0.05);
  for (std::size_t i = 5; i < s.detections.size(); i += 17) {
    for (auto& corner : s.detections[i].normalized) corner.x() += 10.0 / 520.0;  // 10 pixels
  }
  const auto gated = [&](double gate_after) {
    BundleProblem problem = s.problem;
    BundleOptions options = kToTheEnd;
    options.max_iterations = 8;
    options.min_relative_decrease = 0.0;
    options.gate_after = gate_after;
    return adjustBundle(&problem, options).gated_views;
  };
  EXPECT_GT(gated(0.5), 3);
  EXPECT_EQ(gated(1.0), 0) << "neither converged nor half way";
}

// A wrong model is not made right by leaving out what contradicts it.
TEST(BundleAdjuster, ManyOutlierViewsAreNotGated) {
  Scenario s(6, 0.05);
  for (std::size_t i = 0; i < s.detections.size(); i += 3) {
    for (auto& corner : s.detections[i].normalized) corner.x() += 10.0 / 520.0;
  }
  EXPECT_EQ(adjustBundle(&s.problem, kToTheEnd).gated_views, 0);
}

// Where the corners are worse than their covariances say, the kernel must widen with them, or all
// of them count as outliers.
TEST(BundleAdjuster, WidensItsKernelToTheNoise) {
  const auto rmsAfter = [](bool estimate) {
    double squared = 0.0;
    int count = 0;
    for (const unsigned seed : {11U, 12U, 13U}) {
      Scenario s(seed, 0.5);
      for (auto& detection : s.detections) {
        for (auto& covariance : detection.covariance) covariance *= 1.0 / 400.0;
      }
      BundleOptions options = kToTheEnd;
      options.estimate_residual_sigma = estimate;
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

  Scenario one_view(9, 0.05, 1);  // a lens can hardly be told from one view: its priors hold it
  one_view.disturbLens(testing::staleLens(), testing::lensSigma());
  const BundleSummary lens_summary = adjustBundle(&one_view.problem, kToTheEnd);
  EXPECT_LT(lens_summary.final_cost, lens_summary.initial_cost);
  EXPECT_TRUE(one_view.problem.lens->camera.intrinsics().allFinite());
  EXPECT_LT((one_view.problem.lens->camera.intrinsics() - one_view.problem.lens->expected)
                .head<8>()
                .cwiseQuotient(testing::lensSigma().head<8>())
                .norm(),
            5.0);

  Scenario floating(8, 0.05);  // no gauge
  floating.problem.cameras[0].fixed = false;
  const BundleSummary free_summary = adjustBundle(&floating.problem, kToTheEnd);
  EXPECT_LE(free_summary.final_cost, free_summary.initial_cost);
  EXPECT_TRUE(floating.problem.markers[0].T.p.allFinite());
}

}  // namespace
}  // namespace waymark::slam
