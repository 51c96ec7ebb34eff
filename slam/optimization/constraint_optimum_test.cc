// Ceres as the independent check: the same markers, with planes as four numbers and distances as
// what they are, between two markers, without any frame.
#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "slam/optimization/bundle_adjuster.h"
#include "slam/optimization/constraint_frames.h"
#include "slam/testing/bundle_scenario.h"
#include "slam/testing/ceres_reference.h"

namespace waymark::slam {
namespace {

using Scenario = testing::BundleScenario;

// Without kernel or gate.
const BundleOptions kLeastSquares{.max_iterations = 100,
                                  .min_relative_decrease = 1e-12,
                                  .huber = 1e6,
                                  .estimate_residual_sigma = false,
                                  .view_chi2 = 0.0};

// What a tape says, a few sigmas from the truth.
CornerDistance measured(const Scenario& s, int a, int corner_a, int b, int corner_b) {
  const auto corners = markerCorners(Scenario::kSizeM);
  const auto at = [](int i) { return static_cast<std::size_t>(i); };
  const double truth_m = (s.true_markers[at(a)] * corners[at(corner_a)] -
                          s.true_markers[at(b)] * corners[at(corner_b)])
                             .norm();
  return {a, corner_a, b, corner_b, truth_m + 0.01, 0.003};
}

MarkerConstraints someConstraints(const Scenario& s) {
  MarkerConstraints known;
  known.planes = {{.ids = {{0, 6}}, .sigma_m = 0.01, .sigma_rad = 0.3}};
  known.distances = {measured(s, 0, 1, 11, 3), measured(s, 2, 0, 9, 2)};
  return known;
}

void addTo(const MarkerConstraints& known, BundleProblem* problem) {
  std::vector<ConstrainedMarker> markers;
  for (std::size_t m = 0; m < problem->markers.size(); ++m) {
    markers.push_back({static_cast<int>(m), problem->markers[m].T, problem->marker_sizes_m[m]});
  }
  ConstraintFrames frames = constraintFrames(known, markers, false);
  for (const MeasuredDistance& distance : frames.distances) {
    frames.frames.push_back(rulerOf(distance, markers));
  }
  for (const ConstraintFrame& frame : frames.frames) {
    const auto camera = static_cast<int>(problem->cameras.size());
    problem->cameras.push_back({frame.T_w_f, frame.fixed});
    problem->gauges.push_back({camera, frame.gauge});
    for (const ConstraintFrame::Member& member : frame.members) {
      problem->constraints.push_back({camera, static_cast<int>(member.marker), member.relations});
    }
  }
  problem->constraint_sources = static_cast<int>(frames.sources.size());
}

TEST(ConstraintOptimum, IsTheSameAsThatOfCeres) {
  for (const int cameras : {6, 20}) {  // fewer and more than the 12 markers: both eliminations
    Scenario s(31, 0.3, cameras);
    const MarkerConstraints known = someConstraints(s);
    testing::CeresBundle reference(s.problem, kLeastSquares.huber);
    for (const CornerDistance& distance : known.distances)
      reference.addDistance(distance, Scenario::kSizeM);
    reference.addPlane({0, 1, 2, 3, 4, 5, 6}, known.planes[0].sigma_m, known.planes[0].sigma_rad);
    const double optimum = reference.solve();
    addTo(known, &s.problem);
    const BundleSummary summary = adjustBundle(&s.problem, kLeastSquares);
    EXPECT_FALSE(summary.failed);
    EXPECT_NEAR(summary.final_cost, optimum, 1e-5 * optimum);
    for (int m = 0; m < 12; ++m) {
      const Transform& found = s.problem.markers[static_cast<std::size_t>(m)].T;
      EXPECT_LT((found.p - reference.marker(m).p).norm(), 1e-5) << m;
      EXPECT_LT(rotationDistance(found.R, reference.marker(m).R), 1e-4) << m;
    }
  }
}

// Within, they are in units of corners' noise that is larger than it is said to be.
TEST(ConstraintOptimum, AnAdjustmentLeavesTheSigmasAsTheyWere) {
  Scenario s(32, 0.3);
  for (MarkerDetection& detection : s.detections) {
    for (auto& covariance : detection.covariance) covariance *= 0.04;
  }
  addTo(someConstraints(s), &s.problem);
  const Eigen::Vector3d before = s.problem.constraints.front().relations.front().weight;
  const BundleSummary summary = adjustBundle(&s.problem);
  EXPECT_GT(summary.residual_sigma, 3.0);
  const Eigen::Vector3d after = s.problem.constraints.front().relations.front().weight;
  EXPECT_LT((after - before).norm(), 1e-9 * before.norm());
}

}  // namespace
}  // namespace waymark::slam
