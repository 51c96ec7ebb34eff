#include "slam/loop_closure/pose_graph.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "slam/optimization/block_system.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Inverse of the right Jacobian of SO(3): d logSo3(E Exp(x)) / dx at x = 0, for logSo3(E) = r.
Eigen::Matrix3d inverseRightJacobian(const Eigen::Vector3d& r) {
  const Eigen::Matrix3d K = skew(r);
  const double theta2 = r.squaredNorm();
  double factor = 1.0 / 12.0;
  if (theta2 > 1e-6) {
    const double theta = std::sqrt(theta2);
    factor = 1.0 / theta2 - (1.0 + std::cos(theta)) / (2.0 * theta * std::sin(theta));
  }
  return Eigen::Matrix3d::Identity() + 0.5 * K + factor * K * K;
}

// What steps cost, in microseconds of a core of 3 GHz.
constexpr double kEdgeError = 0.07;
constexpr double kEdge = 0.5;

Task<double> graphCost(const PoseGraph& graph, const std::vector<Transform>& poses, double scale,
                       Budget* budget) {
  double cost = 0.0;
  for (const PoseGraph::Edge& edge : graph.edges) {
    co_await budget->spend(kEdgeError);
    const auto a = static_cast<std::size_t>(edge.a);
    const auto b = static_cast<std::size_t>(edge.b);
    cost += edge.weight * edgeError(poses[a], poses[b], edge.T_a_b, scale).squaredNorm();
  }
  co_return cost;
}

// Index among the unknowns; -1 for the fixed pose.
int unknown(const PoseGraph& graph, int pose) {
  if (pose == graph.fixed) return -1;
  return pose < graph.fixed ? pose : pose - 1;
}

Task<Done> arrange(const PoseGraph& graph, BlockSystem* system, Budget* budget) {
  std::vector<std::vector<int>> neighbours(graph.poses.size() - 1);
  for (const PoseGraph::Edge& edge : graph.edges) {
    const int a = unknown(graph, edge.a);
    const int b = unknown(graph, edge.b);
    if (a >= 0 && b >= 0) neighbours[static_cast<std::size_t>(a)].push_back(b);
  }
  co_return co_await system->arrange(std::move(neighbours), /*with_globals=*/false, budget);
}

void addEdge(const PoseGraph& graph, const PoseGraph::Edge& edge, double scale, double lambda,
             BlockSystem* system) {
  const Transform& T_w_a = graph.poses[static_cast<std::size_t>(edge.a)];
  const Transform& T_w_b = graph.poses[static_cast<std::size_t>(edge.b)];
  const Vector6d e = edgeError(T_w_a, T_w_b, edge.T_a_b, scale);
  const EdgeJacobians J = edgeJacobians(T_w_a, T_w_b, edge.T_a_b, scale);
  const auto addOwn = [&](int pose, const Matrix6d& J_own) {
    Matrix6d H = edge.weight * J_own.transpose() * J_own;
    H.diagonal() *= 1.0 + lambda;
    system->diagonal(system->positionOf(pose)) += H;
    system->right(system->positionOf(pose)) -= edge.weight * J_own.transpose() * e;
  };
  const int a = unknown(graph, edge.a);
  const int b = unknown(graph, edge.b);
  if (a >= 0) addOwn(a, J.a);
  if (b >= 0) addOwn(b, J.b);
  if (a < 0 || b < 0) return;
  const Matrix6d H = edge.weight * J.a.transpose() * J.b;
  const int row = system->positionOf(a);
  const int column = system->positionOf(b);
  if (row > column) {
    system->block(system->place(row, column)) += H;
  } else {
    system->block(system->place(column, row)) += H.transpose();
  }
}

// The step is left in the system's right sides; false when there is none.
Task<bool> solve(const PoseGraph& graph, double scale, double lambda, BlockSystem* system,
                 Budget* budget) {
  (void)co_await system->clear(budget);
  // A pose without an edge stays where it is, and the system is still positive definite.
  for (int i = 0; i < system->poses(); ++i) {
    system->diagonal(i).diagonal().setConstant(1e-12);
  }
  for (const PoseGraph::Edge& edge : graph.edges) {
    co_await budget->spend(kEdge);
    addEdge(graph, edge, scale, lambda, system);
  }
  co_return co_await system->solve(budget);
}

}  // namespace

std::string PoseGraphOptions::invalidReason() const {
  return firstUnmet({
      {max_iterations >= 1, "a pose graph needs at least 1 iteration"},
      {isNotNegative(min_relative_decrease), "the least decrease of a cost must not be negative"},
      {isPositive(radians_per_metre), "the weight of a metre in a pose graph must be positive"},
  });
}

Vector6d edgeError(const Transform& T_w_a, const Transform& T_w_b, const Transform& T_a_b,
                   double radians_per_metre) {
  const Transform difference = T_a_b.inverse() * T_w_a.inverse() * T_w_b;
  Vector6d error;
  error << radians_per_metre * difference.p, logSo3(difference.R);
  return error;
}

EdgeJacobians edgeJacobians(const Transform& T_w_a, const Transform& T_w_b, const Transform& T_a_b,
                            double radians_per_metre) {
  const Eigen::Matrix3d R_ba_aw = T_a_b.R.transpose() * T_w_a.R.transpose();
  const Eigen::Vector3d r = logSo3(R_ba_aw * T_w_b.R);
  const Eigen::Matrix3d J_r = inverseRightJacobian(r) * T_w_b.R.transpose();
  EdgeJacobians J;
  J.a.setZero();
  J.b.setZero();
  J.a.topLeftCorner<3, 3>() = -radians_per_metre * R_ba_aw;
  J.a.topRightCorner<3, 3>() = radians_per_metre * R_ba_aw * skew(T_w_b.p - T_w_a.p);
  J.a.bottomRightCorner<3, 3>() = -J_r;
  J.b.topLeftCorner<3, 3>() = radians_per_metre * R_ba_aw;
  J.b.bottomRightCorner<3, 3>() = J_r;
  return J;
}

Task<PoseGraphSummary> optimizePoseGraph(PoseGraph* graph, const PoseGraphOptions& options,
                                         Budget* budget) {
  constexpr double kHopeless = 1e8;  // damping beyond which no step will help
  PoseGraphSummary summary;
  if (graph->poses.empty()) co_return summary;
  const double scale = options.radians_per_metre;
  summary.initial_cost = summary.final_cost =
      co_await graphCost(*graph, graph->poses, scale, budget);
  BlockSystem system;
  (void)co_await arrange(*graph, &system, budget);
  double lambda = 1e-6;
  std::vector<Transform> trial = graph->poses;
  while (summary.iterations < options.max_iterations && lambda < kHopeless) {
    ++summary.iterations;
    const bool solved = co_await solve(*graph, scale, lambda, &system, budget);
    double cost = summary.final_cost;
    if (solved) {
      for (int i = 0; i < static_cast<int>(trial.size()); ++i) {
        const int row = unknown(*graph, i);
        if (row < 0) continue;
        co_await budget->spend(kEdgeError);
        const auto at = static_cast<std::size_t>(i);
        trial[at] = graph->poses[at].retract(system.right(system.positionOf(row)));
      }
      cost = co_await graphCost(*graph, trial, scale, budget);
    }
    if (!solved || !(cost <= summary.final_cost)) {
      lambda *= 10.0;
      continue;
    }
    const double decrease = summary.final_cost - cost;
    graph->poses = trial;
    summary.final_cost = cost;
    lambda = std::max(0.1 * lambda, 1e-12);
    if (decrease <= options.min_relative_decrease * cost) break;
  }
  co_return summary;
}

}  // namespace waymark::slam
