#include "slam/marker_pose/marker_resolver.h"

#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "slam/testing/ceres_reference.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.12;

// A small, far, almost frontal marker: ambiguous in every single view.
class MarkerResolverTest : public ::testing::Test {
 protected:
  std::vector<MarkerView> views(int count, double baseline_m) {
    detections_.clear();
    std::vector<MarkerView> out;
    for (int i = 0; i < count; ++i) {
      const double x = baseline_m * (i - 0.5 * (count - 1));
      const Transform T_w_c = testing::lookAt({x, -1.2, 0.1 * (i % 2)}, T_w_m_.p);
      auto seen = testing::observe(camera_, T_w_c, 0, T_w_m_, kSize, 0.15, &rng_);
      EXPECT_TRUE(seen);
      detections_.push_back(*seen);
      out.push_back({nullptr, T_w_c});
    }
    for (std::size_t i = 0; i < out.size(); ++i) out[i].detection = &detections_[i];
    return out;
  }

  std::mt19937 rng_{11};
  CameraModel camera_{testing::testCalibration()};
  Transform T_w_m_ = testing::markerFacing({0.0, 3.0, 0.0}, {0.5, 0.0, 0.2});
  std::vector<MarkerDetection> detections_;
};

TEST_F(MarkerResolverTest, ManyAmbiguousViewsDecide) {
  const auto found = resolveMarkerPose(views(8, 0.35), kSize, camera_.focalLength(), 1.0);
  ASSERT_EQ(found.verdict, ResolverVerdict::kResolved);
  EXPECT_GT(found.ratio, 3.0);
  EXPECT_LT(rotationDistance(found.T_w_m.R, T_w_m_.R), 0.06);
  EXPECT_LT((found.T_w_m.p - T_w_m_.p).norm(), 0.02);
}

// Eq. 26 over all views: the best of both orientations, each as good as Ceres can make it.
TEST_F(MarkerResolverTest, ReachesTheSameOptimaAsCeres) {
  for (int trial = 0; trial < 5; ++trial) {
    const auto many = views(4, 0.05);
    const auto found = resolveMarkerPose(many, kSize, camera_.focalLength(), 1.0);
    ASSERT_TRUE(found.other_T_w_m);
    const auto problemAt = [&](const Transform& T_w_m) {
      BundleProblem problem;
      problem.markers = {{T_w_m, false}};
      problem.marker_sizes_m = {kSize};
      for (const MarkerView& view : many) {
        problem.observations.push_back(
            {static_cast<int>(problem.cameras.size()), 0, view.detection});
        problem.cameras.push_back({view.T_w_c, true});
      }
      return testing::CeresBundle(problem, std::numeric_limits<double>::infinity());
    };
    double costs[2] = {0.0, 0.0};
    const Transform* poses[2] = {&found.T_w_m, &*found.other_T_w_m};
    for (int k = 0; k < 2; ++k) {
      costs[k] = problemAt(*poses[k]).cost();
      const double optimum = problemAt(*poses[k]).solve();
      EXPECT_NEAR(costs[k], optimum, 1e-3 * optimum) << "trial " << trial;
    }
    EXPECT_LE(costs[0], costs[1]);
    // From the truth Ceres finds one of the two, not a third one.
    const double from_truth = problemAt(T_w_m_).solve();
    EXPECT_NEAR(std::min(std::abs(from_truth - costs[0]), std::abs(from_truth - costs[1])), 0.0,
                1e-3 * from_truth);
  }
}

TEST_F(MarkerResolverTest, TooFewViewsOrNoBaselineDoNot) {
  const auto verdict = [&](const std::vector<MarkerView>& views) {
    return resolveMarkerPose(views, kSize, camera_.focalLength(), 1.0).verdict;
  };
  EXPECT_EQ(verdict(views(2, 0.35)), ResolverVerdict::kTooFewViews);
  EXPECT_EQ(verdict(views(6, 0.001)), ResolverVerdict::kUndecided);
  EXPECT_EQ(verdict({}), ResolverVerdict::kTooFewViews);
}

// What is undecided is not lost: both poses are there.
TEST_F(MarkerResolverTest, KeepsTheSecondHypothesis) {
  const auto found = resolveMarkerPose(views(4, 0.01), kSize, camera_.focalLength(), 1.0);
  ASSERT_EQ(found.verdict, ResolverVerdict::kUndecided);
  ASSERT_TRUE(found.other_T_w_m);
  EXPECT_LT(std::min(rotationDistance(found.T_w_m.R, T_w_m_.R),
                     rotationDistance(found.other_T_w_m->R, T_w_m_.R)),
            0.1);
}

TEST_F(MarkerResolverTest, NamesTheViewThatContradictsTheOthers) {
  for (const std::size_t wrong : {0U, 3U, 5U}) {
    auto many = views(6, 0.35);
    for (auto& corner : detections_[wrong].normalized) corner.x() += 12.0 / camera_.focalLength();
    const auto found = resolveMarkerPose(many, kSize, camera_.focalLength(), 1.0);
    ASSERT_EQ(found.verdict, ResolverVerdict::kContradictory);
    EXPECT_EQ(found.worst_view, wrong);
  }
}

TEST_F(MarkerResolverTest, RejectsViewsThatContradictEachOther) {
  auto many = views(8, 0.35);
  for (std::size_t i = 0; i < many.size(); i += 2) many[i].T_w_c.p.x() += 0.5;  // wrong poses
  const auto found = resolveMarkerPose(many, kSize, camera_.focalLength(), 1.0);
  EXPECT_EQ(found.verdict, ResolverVerdict::kContradictory);
}

}  // namespace
}  // namespace waymark::slam
