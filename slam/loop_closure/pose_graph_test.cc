#include "slam/loop_closure/pose_graph.h"

#include <deque>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

#include "slam/testing/ceres_reference.h"
#include "slam/testing/numeric.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

PoseGraphSummary optimize(PoseGraph* graph, const PoseGraphOptions& options = {}) {
  return runToCompletion([&](Budget* a) { return optimizePoseGraph(graph, options, a); });
}

const PoseGraphOptions kToTheEnd{.max_iterations = 200, .min_relative_decrease = 1e-14};

// A walk round a circle of 2 m: the truth, and a graph whose edges were measured with noise of
// sigma (metres and radians), whose poses are those edges one after the other, and whose last edge
// closes the loop exactly.
struct Ring {
  Ring(int count, double sigma, std::mt19937* rng) {
    for (int i = 0; i < count; ++i) {
      truth.push_back(testing::roomView(2.0 * std::numbers::pi * i / count, 2.0));
    }
    graph.poses = {truth[0]};
    for (int i = 1; i < count; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const Transform measured =
          testing::disturbed(truth[at - 1].inverse() * truth[at], sigma, rng);
      graph.edges.push_back({i - 1, i, measured});
      graph.poses.push_back(graph.poses.back() * measured);
    }
    graph.edges.push_back({count - 1, 0, truth.back().inverse() * truth.front()});
  }

  [[nodiscard]] double largestError() const {
    double largest = 0.0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      largest = std::max(largest, (graph.poses[i].p - truth[i].p).norm());
    }
    return largest;
  }

  std::vector<Transform> truth;
  PoseGraph graph;
};

TEST(PoseGraph, JacobiansMatchFiniteDifferences) {
  std::mt19937 rng(1);
  for (const double spread : {0.01, 0.3, 1.0}) {  // the error's rotation: small to large
    for (int i = 0; i < 20; ++i) {
      const Transform T_w_a = testing::disturbed(Transform{}, 1.0, &rng);
      const Transform T_w_b = testing::disturbed(Transform{}, 1.0, &rng);
      const Transform T_a_b = testing::disturbed(T_w_a.inverse() * T_w_b, spread, &rng);
      const EdgeJacobians J = edgeJacobians(T_w_a, T_w_b, T_a_b, 0.5);
      const auto by_a = testing::numericJacobian(
          T_w_a, [&](const Transform& T) { return edgeError(T, T_w_b, T_a_b, 0.5); });
      const auto by_b = testing::numericJacobian(
          T_w_b, [&](const Transform& T) { return edgeError(T_w_a, T, T_a_b, 0.5); });
      // Near half a turn the logarithm's branch changes; finite differences mean nothing there.
      if (edgeError(T_w_a, T_w_b, T_a_b, 0.5).tail<3>().norm() > 3.0) continue;
      EXPECT_LT((J.a - by_a).norm(), 1e-6) << J.a << "\n\n" << by_a;
      EXPECT_LT((J.b - by_b).norm(), 1e-6) << J.b << "\n\n" << by_b;
    }
  }
}

TEST(PoseGraph, TheErrorIsZeroWhereTheEdgeHolds) {
  std::mt19937 rng(2);
  const Transform T_w_a = testing::disturbed(Transform{}, 1.0, &rng);
  const Transform T_a_b = testing::disturbed(Transform{}, 1.0, &rng);
  EXPECT_LT(edgeError(T_w_a, T_w_a * T_a_b, T_a_b, 0.5).norm(), 1e-9);
  Transform off = T_a_b;
  off.p.x() += 0.1;
  EXPECT_NEAR(edgeError(T_w_a, T_w_a * off, T_a_b, 0.5).norm(), 0.05, 1e-9);
}

// Dense and sparse (more than 150 unknown poses).
TEST(PoseGraph, ExactEdgesGiveTheTruthBack) {
  for (const int count : {20, 200}) {
    std::mt19937 rng(3);
    Ring ring(count, 0.0, &rng);
    for (int i = 1; i < count; ++i) {
      auto& T = ring.graph.poses[static_cast<std::size_t>(i)];
      T = testing::disturbed(T, 0.1, &rng);
    }
    const PoseGraphSummary summary = optimize(&ring.graph, kToTheEnd);
    EXPECT_GT(summary.initial_cost, 0.1);
    EXPECT_LT(summary.final_cost, 1e-10);
    EXPECT_LT(ring.largestError(), 1e-4);
  }
}

TEST(PoseGraph, AClosedLoopTakesTheDriftBack) {
  for (const int count : {30, 180}) {
    std::mt19937 rng(4);
    Ring ring(count, 0.02, &rng);
    const double before = ring.largestError();
    const auto gap = [&] {
      return (ring.graph.poses.back().inverse() * ring.graph.poses.front())
          .localCoordinates(ring.graph.edges.back().T_a_b)
          .norm();
    };
    const double gap_before = gap();
    (void)optimize(&ring.graph);
    // The difference is shared by as many edges as there are: the last one keeps its part.
    EXPECT_LT(gap(), 2.0 * gap_before / count);
    EXPECT_LT(ring.largestError(), 0.5 * before);
    EXPECT_EQ(ring.graph.poses[0].p, ring.truth[0].p) << "the fixed pose does not move";
    EXPECT_EQ(ring.graph.poses[0].R, ring.truth[0].R);
  }
}

TEST(PoseGraph, AnyPoseCanBeTheFixedOne) {
  std::mt19937 rng(5);
  Ring ring(20, 0.02, &rng);
  ring.graph.fixed = 7;
  const Transform held = ring.graph.poses[7];
  PoseGraph other = ring.graph;
  other.fixed = 0;
  const double cost = optimize(&ring.graph, kToTheEnd).final_cost;
  EXPECT_EQ(ring.graph.poses[7].p, held.p);
  EXPECT_EQ(ring.graph.poses[7].R, held.R);
  EXPECT_NEAR(cost, optimize(&other, kToTheEnd).final_cost, 1e-6 * cost);
}

struct EdgeResidual {
  PoseGraph::Edge edge;
  double scale;
  bool operator()(const double* a, const double* b, double* residual) const {
    const Transform off =
        edge.T_a_b.inverse() * (testing::poseOf(a).inverse() * testing::poseOf(b));
    Eigen::Map<Vector6d> r(residual);
    const Eigen::AngleAxisd turn(off.R);
    r << scale * off.p, turn.angle() * turn.axis();
    r *= std::sqrt(edge.weight);
    return true;
  }
};

TEST(PoseGraph, ReachesTheSameOptimumAsCeres) {
  for (const unsigned seed : {6U, 7U, 8U}) {
    std::mt19937 rng(seed);
    Ring ring(25, 0.05, &rng);
    // Chords and weights, so that the optimum is no even spread.
    std::uniform_real_distribution<double> weight(0.2, 5.0);
    for (int i = 0; i + 5 < 25; i += 3) {
      const auto a = static_cast<std::size_t>(i);
      const Transform chord = ring.truth[a].inverse() * ring.truth[a + 5];
      ring.graph.edges.push_back({i, i + 5, testing::disturbed(chord, 0.05, &rng)});
    }
    for (auto& edge : ring.graph.edges) edge.weight = weight(rng);

    std::deque<testing::PoseBlock> blocks;
    for (const Transform& T : ring.graph.poses) blocks.push_back(testing::blockOf(T));
    ceres::Problem problem;
    for (const auto& edge : ring.graph.edges) {
      problem.AddResidualBlock(
          new ceres::NumericDiffCostFunction<EdgeResidual, ceres::CENTRAL, 6, 6, 6>(
              new EdgeResidual{edge, kToTheEnd.radians_per_metre}),
          nullptr, blocks[static_cast<std::size_t>(edge.a)].data(),
          blocks[static_cast<std::size_t>(edge.b)].data());
    }
    problem.SetParameterBlockConstant(blocks[0].data());
    const double initial = testing::costWithCeres(&problem);
    const double optimum = testing::solveWithCeres(&problem);
    const PoseGraphSummary summary = optimize(&ring.graph, kToTheEnd);
    EXPECT_NEAR(summary.initial_cost, initial, 1e-6 * initial);
    EXPECT_LT(optimum, 0.9 * initial);
    EXPECT_NEAR(summary.final_cost, optimum, 1e-3 * optimum) << "seed " << seed;
  }
}

TEST(PoseGraph, EmptyGraphsDoNoHarm) {
  PoseGraph empty;
  EXPECT_EQ(optimize(&empty).final_cost, 0.0);
  PoseGraph single;
  single.poses = {testing::roomView(1.0)};
  EXPECT_EQ(optimize(&single).final_cost, 0.0);
  EXPECT_EQ(single.poses[0].p, testing::roomView(1.0).p);
}

// What no edge joins to the loop neither moves nor keeps the loop from being closed; dense and
// sparse. (A keyframe whose only marker was quarantined has no edge at all.)
TEST(PoseGraph, WhatIsNotConnectedStaysAndDoesNotHinder) {
  for (const int count : {30, 180}) {
    std::mt19937 rng(9);
    Ring ring(count, 0.02, &rng);
    PoseGraph alone = ring.graph;
    const double cost = optimize(&alone, kToTheEnd).final_cost;

    const Transform lonely = testing::roomView(0.3);
    const Transform pair[] = {testing::roomView(1.0), testing::roomView(1.2)};
    ring.graph.poses.insert(ring.graph.poses.end(), {lonely, pair[0], pair[1]});
    ring.graph.edges.push_back({count + 1, count + 2, pair[0].inverse() * pair[1]});
    const PoseGraphSummary summary = optimize(&ring.graph, kToTheEnd);
    EXPECT_NEAR(summary.final_cost, cost, 1e-3 * cost);
    const auto n = static_cast<std::size_t>(count);
    EXPECT_LT((ring.graph.poses[n].p - lonely.p).norm(), 1e-9);
    EXPECT_LT((ring.graph.poses[n + 1].p - pair[0].p).norm(), 1e-6);
    EXPECT_LT((ring.graph.poses[n + 2].p - pair[1].p).norm(), 1e-6);
  }
}

}  // namespace
}  // namespace waymark::slam
