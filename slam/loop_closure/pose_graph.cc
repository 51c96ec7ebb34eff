#include "slam/loop_closure/pose_graph.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "slam/optimisation/reduced_system.h"

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

double graphCost(const PoseGraph& graph, const std::vector<Transform>& poses, double scale) {
  double cost = 0.0;
  for (const PoseGraph::Edge& edge : graph.edges) {
    const auto a = static_cast<std::size_t>(edge.a);
    const auto b = static_cast<std::size_t>(edge.b);
    cost += edge.weight * edgeError(poses[a], poses[b], edge.T_a_b, scale).squaredNorm();
  }
  return cost;
}

// Index among the unknowns; -1 for the fixed pose.
int unknown(const PoseGraph& graph, int pose) {
  if (pose == graph.fixed) return -1;
  return pose < graph.fixed ? pose : pose - 1;
}

std::optional<Eigen::VectorXd> solve(const PoseGraph& graph, double scale, double lambda) {
  ReducedSystem system(static_cast<int>(graph.poses.size()) - 1, /*with_lens=*/false);
  const auto add = [&](int row, int column, const Matrix6d& block) {
    if (row < 0 || column < 0) return;
    if (row < column) {
      system.addBlock(column, row, block.transpose());
    } else {
      system.addBlock(row, column, block);
    }
  };
  const auto damped = [&](Matrix6d H) {
    H.diagonal() *= 1.0 + lambda;
    return H;
  };
  // A pose without an edge stays where it is, and the system is still positive definite.
  for (int i = 0; i + 1 < static_cast<int>(graph.poses.size()); ++i) {
    add(i, i, 1e-12 * Matrix6d::Identity());
  }
  for (const PoseGraph::Edge& edge : graph.edges) {
    const Transform& T_w_a = graph.poses[static_cast<std::size_t>(edge.a)];
    const Transform& T_w_b = graph.poses[static_cast<std::size_t>(edge.b)];
    const Vector6d e = edgeError(T_w_a, T_w_b, edge.T_a_b, scale);
    const EdgeJacobians J = edgeJacobians(T_w_a, T_w_b, edge.T_a_b, scale);
    const int a = unknown(graph, edge.a);
    const int b = unknown(graph, edge.b);
    add(a, a, damped(edge.weight * J.a.transpose() * J.a));
    add(b, b, damped(edge.weight * J.b.transpose() * J.b));
    add(a, b, edge.weight * J.a.transpose() * J.b);
    if (a >= 0) system.addRight(a, -edge.weight * J.a.transpose() * e);
    if (b >= 0) system.addRight(b, -edge.weight * J.b.transpose() * e);
  }
  return system.solve();
}

}  // namespace

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

PoseGraphSummary optimisePoseGraph(PoseGraph* graph, const PoseGraphOptions& options) {
  constexpr double kHopeless = 1e8;
  PoseGraphSummary summary;
  if (graph->poses.empty()) return summary;
  const double scale = options.radians_per_metre;
  summary.initial_cost = summary.final_cost = graphCost(*graph, graph->poses, scale);
  double lambda = 1e-6;
  std::vector<Transform> trial = graph->poses;
  while (summary.iterations < options.max_iterations && lambda < kHopeless) {
    ++summary.iterations;
    const auto step = solve(*graph, scale, lambda);
    if (step) {
      for (int i = 0; i < static_cast<int>(trial.size()); ++i) {
        const int row = unknown(*graph, i);
        if (row < 0) continue;
        const auto at = static_cast<std::size_t>(i);
        trial[at] = graph->poses[at].retract(step->segment<6>(6 * row));
      }
    }
    const double cost = step ? graphCost(*graph, trial, scale) : summary.final_cost;
    if (!step || !(cost <= summary.final_cost)) {
      lambda *= 10.0;
      continue;
    }
    const double decrease = summary.final_cost - cost;
    graph->poses = trial;
    summary.final_cost = cost;
    lambda = std::max(0.1 * lambda, 1e-12);
    if (decrease <= options.min_relative_decrease * cost) break;
  }
  return summary;
}

}  // namespace waymark::slam
