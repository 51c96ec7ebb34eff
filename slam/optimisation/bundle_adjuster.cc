#include "slam/optimisation/bundle_adjuster.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include <Eigen/Cholesky>

#include "slam/geometry/reprojection.h"
#include "slam/geometry/robust.h"

namespace waymark::slam {
namespace {

using Poses = std::vector<BundleProblem::Pose>;

// The normal equations in blocks: one 6x6 per camera, per marker, and per observation between them.
struct BlockSystem {
  std::vector<Matrix6d> H_camera, H_marker;
  std::vector<Vector6d> g_camera, g_marker;
  std::vector<Matrix6d> H_cross;  // camera rows, marker columns; by observation
  double cost = 0.0;
};

// False when a corner is behind its camera.
bool linearise(const BundleProblem& problem, double huber, BlockSystem* system) {
  system->H_camera.assign(problem.cameras.size(), Matrix6d::Zero());
  system->g_camera.assign(problem.cameras.size(), Vector6d::Zero());
  system->H_marker.assign(problem.markers.size(), Matrix6d::Zero());
  system->g_marker.assign(problem.markers.size(), Vector6d::Zero());
  system->H_cross.assign(problem.observations.size(), Matrix6d::Zero());
  system->cost = 0.0;
  for (std::size_t o = 0; o < problem.observations.size(); ++o) {
    const auto& observation = problem.observations[o];
    const auto c = static_cast<std::size_t>(observation.camera);
    const auto m = static_cast<std::size_t>(observation.marker);
    const Transform& T_w_c = problem.cameras[c].T;
    const Transform& T_w_m = problem.markers[m].T;
    const auto corners = markerCorners(problem.marker_sizes_m[m]);
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d p = T_w_m * corners[k];
      Projection projection;
      if (!projectPoint(T_w_c, p, &projection)) return false;
      const Eigen::Matrix2d W = whitening(observation.detection->covariance[k]);
      const Eigen::Vector2d r = W * (projection.normalised - observation.detection->normalised[k]);
      const double squared = r.squaredNorm();
      system->cost += huberCost(squared, huber);
      const double weight = huberWeight(squared, huber);
      const Matrix26d J_c = W * cameraJacobian(T_w_c, p, projection.J_point);
      const Matrix26d J_m = W * markerJacobian(T_w_m, p, projection.J_point);
      const Matrix26d wJ_c = weight * J_c;
      const Matrix26d wJ_m = weight * J_m;
      system->H_camera[c].noalias() += wJ_c.transpose() * J_c;
      system->g_camera[c].noalias() += wJ_c.transpose() * r;
      system->H_marker[m].noalias() += wJ_m.transpose() * J_m;
      system->g_marker[m].noalias() += wJ_m.transpose() * r;
      system->H_cross[o].noalias() += wJ_c.transpose() * J_m;
    }
  }
  return true;
}

// One side of the bipartite problem as the Schur complement sees it.
struct Group {
  const Poses* poses;
  const std::vector<Matrix6d>* H;
  const std::vector<Vector6d>* g;
};

// Indices of the free poses in the reduced system; -1 for fixed ones.
std::vector<int> freeIndices(const Poses& poses, int* count) {
  std::vector<int> index(poses.size(), -1);
  *count = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!poses[i].fixed) index[i] = (*count)++;
  }
  return index;
}

struct Step {
  std::vector<Vector6d> camera, marker;  // zero for fixed poses
};

// Solves the damped normal equations by eliminating one group. False when they are singular.
bool solve(const BundleProblem& problem, const BlockSystem& system, double lambda, Step* step) {
  const Group cameras{&problem.cameras, &system.H_camera, &system.g_camera};
  const Group markers{&problem.markers, &system.H_marker, &system.g_marker};
  const bool eliminate_cameras = problem.cameras.size() >= problem.markers.size();
  const Group& gone = eliminate_cameras ? cameras : markers;
  const Group& kept = eliminate_cameras ? markers : cameras;

  int kept_count = 0;
  const std::vector<int> kept_index = freeIndices(*kept.poses, &kept_count);
  Eigen::MatrixXd S = Eigen::MatrixXd::Zero(6 * kept_count, 6 * kept_count);
  Eigen::VectorXd b(6 * kept_count);
  for (std::size_t i = 0; i < kept.poses->size(); ++i) {
    if (kept_index[i] < 0) continue;
    Matrix6d H = (*kept.H)[i];
    H.diagonal() *= 1.0 + lambda;
    H.diagonal().array() += 1e-12;
    S.block<6, 6>(6 * kept_index[i], 6 * kept_index[i]) = H;
    b.segment<6>(6 * kept_index[i]) = -(*kept.g)[i];
  }

  // Observations of each eliminated pose.
  std::vector<std::vector<std::size_t>> seen(gone.poses->size());
  for (std::size_t o = 0; o < problem.observations.size(); ++o) {
    const auto& observation = problem.observations[o];
    seen[static_cast<std::size_t>(eliminate_cameras ? observation.camera : observation.marker)]
        .push_back(o);
  }
  const auto keptOf = [&](std::size_t o) {
    const auto& observation = problem.observations[o];
    return static_cast<std::size_t>(eliminate_cameras ? observation.marker : observation.camera);
  };
  // Rows: the eliminated pose; columns: the kept one.
  const auto crossOf = [&](std::size_t o) -> Matrix6d {
    return eliminate_cameras ? system.H_cross[o] : Matrix6d(system.H_cross[o].transpose());
  };

  std::vector<Matrix6d> inverse(gone.poses->size(), Matrix6d::Zero());
  for (std::size_t e = 0; e < gone.poses->size(); ++e) {
    if ((*gone.poses)[e].fixed || seen[e].empty()) continue;
    Matrix6d H = (*gone.H)[e];
    H.diagonal() *= 1.0 + lambda;
    H.diagonal().array() += 1e-12;
    inverse[e] = H.ldlt().solve(Matrix6d::Identity());
    for (const std::size_t o1 : seen[e]) {
      const int i = kept_index[keptOf(o1)];
      if (i < 0) continue;
      const Matrix6d WtHinv = crossOf(o1).transpose() * inverse[e];
      b.segment<6>(6 * i) += WtHinv * (*gone.g)[e];
      for (const std::size_t o2 : seen[e]) {
        const int j = kept_index[keptOf(o2)];
        if (j < 0 || j > i) continue;  // lower triangle
        S.block<6, 6>(6 * i, 6 * j).noalias() -= WtHinv * crossOf(o2);
      }
    }
  }

  Eigen::VectorXd x = Eigen::VectorXd::Zero(6 * kept_count);
  if (kept_count > 0) {
    const Eigen::LLT<Eigen::MatrixXd, Eigen::Lower> factor(S);
    if (factor.info() != Eigen::Success) return false;
    x = factor.solve(b);
    if (!x.allFinite()) return false;
  }

  std::vector<Vector6d>& kept_step = eliminate_cameras ? step->marker : step->camera;
  std::vector<Vector6d>& gone_step = eliminate_cameras ? step->camera : step->marker;
  kept_step.assign(kept.poses->size(), Vector6d::Zero());
  gone_step.assign(gone.poses->size(), Vector6d::Zero());
  for (std::size_t i = 0; i < kept.poses->size(); ++i) {
    if (kept_index[i] >= 0) kept_step[i] = x.segment<6>(6 * kept_index[i]);
  }
  for (std::size_t e = 0; e < gone.poses->size(); ++e) {
    if ((*gone.poses)[e].fixed || seen[e].empty()) continue;
    Vector6d rhs = -(*gone.g)[e];
    for (const std::size_t o : seen[e]) rhs -= crossOf(o) * kept_step[keptOf(o)];
    gone_step[e] = inverse[e] * rhs;
  }
  return true;
}

// Fixed poses stay bit-identical.
void movePoses(const Poses& from, const std::vector<Vector6d>& step, Poses* to) {
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (!from[i].fixed) (*to)[i].T = from[i].T.retract(step[i]);
  }
}

// Calls `use` with the squared whitened residual norm of every corner. False when one is behind its
// camera.
template <typename Use>
bool forEachError(const BundleProblem& problem, const Use& use) {
  for (const auto& observation : problem.observations) {
    const auto m = static_cast<std::size_t>(observation.marker);
    const Transform& T_w_c = problem.cameras[static_cast<std::size_t>(observation.camera)].T;
    const auto corners = markerCorners(problem.marker_sizes_m[m]);
    for (std::size_t k = 0; k < 4; ++k) {
      Projection projection;
      if (!projectPoint(T_w_c, problem.markers[m].T * corners[k], &projection)) return false;
      const Eigen::Matrix2d W = whitening(observation.detection->covariance[k]);
      use((W * (projection.normalised - observation.detection->normalised[k])).squaredNorm());
    }
  }
  return true;
}

}  // namespace

double bundleCost(const BundleProblem& problem, const BundleOptions& options) {
  double cost = 0.0;
  const bool seen =
      forEachError(problem, [&](double squared) { cost += huberCost(squared, options.huber); });
  return seen ? cost : std::numeric_limits<double>::infinity();
}

BundleSummary adjustBundle(BundleProblem* problem, const BundleOptions& asked) {
  constexpr double kHopeless = 1e10;
  BundleOptions options = asked;
  BundleSummary summary;
  if (options.estimate_noise) {
    std::vector<double> squared;
    squared.reserve(4 * problem->observations.size());
    if (forEachError(*problem, [&](double s) { squared.push_back(s); })) {
      options.huber *= noiseScale(squared);
    }
  }
  BlockSystem system;
  if (!linearise(*problem, options.huber, &system)) {
    summary.initial_cost = summary.final_cost = std::numeric_limits<double>::infinity();
    summary.failed = true;
    return summary;
  }
  summary.initial_cost = summary.final_cost = system.cost;
  double lambda = 1e-5;
  BundleProblem trial = *problem;
  Step step;
  while (summary.iterations < options.max_iterations && lambda < kHopeless) {
    ++summary.iterations;
    if (!solve(*problem, system, lambda, &step)) {
      lambda = std::max(10.0 * lambda, 1e-6);
      summary.failed = lambda >= kHopeless;
      continue;
    }
    movePoses(problem->cameras, step.camera, &trial.cameras);
    movePoses(problem->markers, step.marker, &trial.markers);
    const double cost = bundleCost(trial, options);
    if (!(cost <= summary.final_cost)) {
      lambda = std::max(10.0 * lambda, 1e-6);
      continue;
    }
    const double decrease = summary.final_cost - cost;
    problem->cameras = trial.cameras;
    problem->markers = trial.markers;
    summary.final_cost = cost;
    lambda = std::max(0.1 * lambda, 1e-12);
    if (decrease <= options.min_relative_decrease * cost) break;
    if (!linearise(*problem, options.huber, &system)) {
      summary.failed = true;
      break;
    }
  }
  return summary;
}

}  // namespace waymark::slam
