#include "slam/covariance/constraint_check.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include "slam/covariance/marginal_recovery.h"
#include "slam/optimization/map_optimizer.h"
#include "slam/testing/dense_system.h"
#include "slam/testing/scene.h"
#include "slam/testing/wall_scene.h"

namespace waymark::slam {
namespace {

using Kind = ConstraintSource::Kind;
constexpr int kMarkers = 12;
constexpr double kSigma_px = 0.1;

std::size_t at(int index) { return static_cast<std::size_t>(index); }

// A wall as it was built and markers as they were hung, what somebody has measured of them, and the
// map of somebody who has walked along them. All errors are as large as their sigmas say.
struct WallRun {
  static constexpr double kOut_m = 0.004;
  static constexpr double kTilt_rad = 0.008;
  static constexpr double kTape_m = 0.003;

  explicit WallRun(unsigned seed) : rng(seed) {
    truth = testing::wallMarkers(kMarkers, kOut_m, kTilt_rad, &rng);
    options.size_m = testing::kWallMarker_m;
    MarkerConstraints& known = options.constraints;
    known.planes = {
        {.name = "north", .ids = {{0, kMarkers - 1}}, .sigma_m = kOut_m, .sigma_rad = kTilt_rad}};
    measure(0, 1, 6, 2);
    measure(6, 0, 11, 3);
    map = testing::trueMap(camera, testing::wallViews(kMarkers), truth, testing::kWallMarker_m,
                           kSigma_px, &rng);
  }

  void measure(int a, int corner_a, int b, int corner_b) {
    const auto corners = markerCorners(testing::kWallMarker_m);
    const Eigen::Vector3d along =
        truth[at(b)].T_w_m * corners[at(corner_b)] - truth[at(a)].T_w_m * corners[at(corner_a)];
    std::normal_distribution<double> noise(0.0, kTape_m);
    options.constraints.distances.push_back(
        {a, corner_a, b, corner_b, along.norm() + noise(rng), kTape_m});
  }

  void optimize() {
    (void)optimizeGlobally(
        &map, options,
        {.max_iterations = 50, .min_relative_decrease = 1e-12, .estimate_residual_sigma = false});
  }

  [[nodiscard]] MapMarginals marginals(std::vector<ConstraintResidual>* known = nullptr) const {
    return runToCompletion([&](Budget* a) {
      return recoverMarginals(map, options, CameraUncertainty{}, 1.0, a, nullptr, known);
    });
  }

  std::mt19937 rng;
  CameraModel camera{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> truth;
  MarkerOptions options;
  Map map;
};

TEST(ConstraintCheck, TheMarginalsAreTheInverseOfAllNormalEquations) {
  WallRun run(3);
  run.options.constraints.upright.ids = {{0, 4}};
  run.optimize();
  constexpr double kNoKernel = 1e9;
  const testing::DenseSystem system = testing::denseSystem(run.map, run.options, kNoKernel);
  const Eigen::MatrixXd inverse = system.H.inverse();
  const std::vector<int>& row = system.row;
  const MapMarginals marginals = run.marginals();
  for (int id = 0; id < kMarkers; ++id) {
    const Matrix6d expected = inverse.block<6, 6>(row[at(id)], row[at(id)]);
    EXPECT_LT((*marginals.find(id) - expected).norm(), 1e-3 * expected.norm()) << id;
  }
}

TEST(ConstraintCheck, WhatIsKnownMakesTheMapSurer) {
  WallRun run(4);
  run.optimize();
  const MapMarginals with = run.marginals();
  run.options.constraints = {};
  const MapMarginals without = run.marginals();
  const int last = kMarkers - 1;
  // How the wall lies to the first keyframe is known no better than before; how straight it is, is.
  EXPECT_LT((*with.find(last))(1, 1), 0.7 * (*without.find(last))(1, 1)) << "out of the wall";
  EXPECT_LT((*with.find(last))(0, 0), 0.9 * (*without.find(last))(0, 0)) << "along it";
}

// Normalized estimation error squared of the markers in the map's world, 6 where the covariance is
// that of the errors; and how far what is known is from what all else says, 1 for each degree of
// freedom.
TEST(ConstraintCheck, CovarianceAndResidualsAreThoseOfTheErrors) {
  constexpr int kRuns = 40;
  double nees = 0.0;
  int markers = 0;
  std::map<Kind, std::pair<double, int>> squared;
  for (unsigned seed = 1; seed <= kRuns; ++seed) {
    WallRun run(seed);
    run.optimize();
    std::vector<ConstraintResidual> known;
    const MapMarginals marginals = run.marginals(&known);
    // The first keyframe is the world, and was true.
    for (int id = 0; id < kMarkers; ++id) {
      const Vector6d error =
          run.truth[at(id)].T_w_m.localCoordinates(*run.map.findPosed(id)->T_w_m);
      nees += error.dot(marginals.find(id)->ldlt().solve(error));
      ++markers;
    }
    for (const ConstraintResidual& residual : known) {
      auto& [sum, count] = squared[residual.source.kind];
      sum += residual.sigmas * residual.sigmas;
      ++count;
    }
  }
  EXPECT_NEAR(nees / markers, 6.0, 0.6);
  const auto mean = [&](Kind kind) { return squared[kind].first / squared[kind].second; };
  EXPECT_EQ(squared[Kind::kPlane].second, kRuns * kMarkers);
  EXPECT_NEAR(mean(Kind::kPlane), 1.0, 0.25);
  EXPECT_NEAR(mean(Kind::kPlaneTilt), 2.0, 0.4);
  EXPECT_EQ(squared[Kind::kDistance].second, 2 * kRuns);
  EXPECT_NEAR(mean(Kind::kDistance), 1.0, 0.45);
}

TEST(ConstraintCheck, AContradictionIsOneLine) {
  WallRun run(5);
  run.optimize();
  EXPECT_TRUE(contradictions({&run.map}, run.options).empty());
  run.options.constraints.distances[1].distance_m += 0.1;
  run.optimize();
  const auto found = contradictions({&run.map}, run.options);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].source.kind, Kind::kDistance);
  EXPECT_EQ(found[0].source.index, 1U);
  const std::string text = constraintText(found[0], run.options);
  EXPECT_TRUE(text.starts_with("marker 6: ")) << text;
  EXPECT_TRUE(text.ends_with(" sigmas from distance 6/0 to 11/3")) << text;
}

// Three are as many as fix a map's place, so nothing else says which of them is the wrong one.
TEST(ConstraintCheck, PositionsThatContradictEachOtherAreTold) {
  std::mt19937 rng(8);
  constexpr double kSize_m = 0.12;
  const CameraModel camera(testing::testCalibration());
  const auto markers = testing::markerWall(2, 4, 0.5, &rng);
  std::vector<Transform> views;
  for (const double x : {-0.4, 0.0, 0.4}) {
    views.push_back(testing::lookAt({x, 0.5, 0.2 * x}, {0.0, 3.0, 0.0}));
  }
  Map map = testing::trueMap(camera, views, markers, kSize_m, kSigma_px, &rng);
  MarkerOptions options{.size_m = kSize_m};
  for (const std::size_t i : {0, 3, 4}) {  // not in one line
    options.constraints.positions.push_back(
        {.id = markers[i].id, .p_w = markers[i].T_w_m.p, .sigma_m = 0.01});
  }
  const auto optimized = [&] {
    (void)optimizeGlobally(&map, options, {.max_iterations = 50});
    return contradictions({&map}, options);
  };
  EXPECT_TRUE(optimized().empty());
  options.constraints.positions[1].p_w.x() += 0.5;
  const auto found = optimized();
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found[0].source.kind, Kind::kPosition);
  EXPECT_GT(found[0].sigmas, 5.0);
}

TEST(ConstraintCheck, OfManyContradictionsTheFirstAreTold) {
  WallRun run(5);
  std::vector<ConstraintResidual> found(10, {.source = {.kind = Kind::kUpright}, .sigmas = 7.0});
  EXPECT_EQ(contradictionLines(found, run.options).size(), 10U);
  found.insert(found.begin(), {.source = {.kind = Kind::kUpright, .marker = 3}, .sigmas = 9.0});
  found.push_back(found.back());
  const auto lines = contradictionLines(found, run.options);
  ASSERT_EQ(lines.size(), 11U);
  EXPECT_EQ(lines.front(), "marker 3: 9.0 sigmas from upright");
  EXPECT_EQ(lines.back(), "and 2 more such contradictions");
}

// As if it had never been said, in the map and in what is known of it.
TEST(ConstraintCheck, WhatIsContradictedMakesNothingSurer) {
  WallRun run(6);
  run.optimize();
  const MapMarginals sound = run.marginals();
  run.options.constraints.distances.push_back(
      {.id_a = 2, .id_b = 9, .distance_m = 5.0, .sigma_m = 0.001});
  run.optimize();
  const MapMarginals marginals = run.marginals();
  for (int id = 0; id < kMarkers; ++id) {
    EXPECT_LT((*marginals.find(id) - *sound.find(id)).norm(), 1e-2 * sound.find(id)->norm()) << id;
  }
}

// Two anchors, of which the second is said to be 10 cm from where it is: anchors are not left out,
// but told.
TEST(ConstraintCheck, AnchorsAreHeldAgainstTheMapToo) {
  WallRun run(7);
  for (const int id : {0, 1, 2}) {
    run.options.anchors.push_back({.id = id, .T_w_m = run.truth[at(id)].T_w_m});
  }
  run.options.anchors[1].T_w_m.p.z() += 0.1;
  run.optimize();
  const auto found = contradictions({&run.map}, run.options);
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found[0].source.kind, Kind::kAnchor);
  EXPECT_EQ(found[0].source.marker, 1);
  EXPECT_TRUE(
      constraintText(found[0], run.options).ends_with("sigmas from where its anchor has it"));
}

TEST(ConstraintCheck, NothingKnownIsNothingToSay) {
  WallRun run(8);
  run.options.constraints = {};
  EXPECT_TRUE(constraintResiduals(run.map, run.options).empty());
  std::vector<ConstraintResidual> known;
  (void)run.marginals(&known);
  EXPECT_TRUE(known.empty());
}

}  // namespace
}  // namespace waymark::slam
