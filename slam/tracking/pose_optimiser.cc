#include "slam/tracking/pose_optimiser.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "slam/geometry/reprojection.h"

namespace waymark::slam {

// Normal equations of Eq. 22 at one pose.
struct PoseOptimiser::Normal {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  double cost = 0.0;  // robust
};

namespace {

double huberCost(double squared, double k) {
  return squared <= k * k ? squared : 2.0 * k * std::sqrt(squared) - k * k;
}

double huberWeight(double squared, double k) {
  return squared <= k * k ? 1.0 : k / std::sqrt(squared);
}

// Adds every used corner to the normal equations. False when a used marker is behind the camera.
template <typename NormalT>
bool accumulate(std::span<const PoseObservation> observations, const std::vector<bool>& use,
                const Transform& T_w_c, double huber, NormalT* normal) {
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!use[i]) continue;
    const PoseObservation& observation = observations[i];
    for (std::size_t k = 0; k < 4; ++k) {
      Projection projection;
      const Eigen::Vector3d& corner = observation.corners_w[k];
      if (!projectPoint(T_w_c, corner, &projection)) return false;
      const Eigen::Matrix2d W = whitening(observation.detection->covariance[k]);
      const Eigen::Vector2d r = W * (projection.normalised - observation.detection->normalised[k]);
      const double squared = r.squaredNorm();
      normal->cost += huberCost(squared, huber);
      const double weight = huberWeight(squared, huber);
      const Matrix26d J = W * cameraJacobian(T_w_c, corner, projection.J_point);
      normal->H.noalias() += weight * J.transpose() * J;
      normal->g.noalias() += weight * J.transpose() * r;
    }
  }
  return true;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

PoseOptimiser::PoseOptimiser(double focal_px, const PoseOptimiserOptions& options)
    : focal_px_(focal_px), options_(options) {}

std::optional<double> PoseOptimiser::markerChi2(const PoseObservation& observation,
                                                const Transform& T_w_c) {
  double chi2 = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    Projection projection;
    if (!projectPoint(T_w_c, observation.corners_w[k], &projection)) return std::nullopt;
    const Eigen::Matrix2d W = whitening(observation.detection->covariance[k]);
    chi2 += (W * (projection.normalised - observation.detection->normalised[k])).squaredNorm();
  }
  return chi2;
}

std::optional<Transform> PoseOptimiser::minimise(std::span<const PoseObservation> observations,
                                                 const std::vector<bool>& use,
                                                 Transform T_w_c) const {
  constexpr double kConverged = 1e-8;  // relative fall of the cost
  constexpr double kHopeless = 1e8;
  Normal now;
  if (!accumulate(observations, use, T_w_c, options_.huber, &now)) return std::nullopt;
  double lambda = 1e-4;
  for (int iteration = 0; iteration < options_.max_iterations && lambda < kHopeless; ++iteration) {
    Matrix6d damped = now.H;
    damped.diagonal() *= 1.0 + lambda;
    const Vector6d step = -damped.ldlt().solve(now.g);
    if (!step.allFinite()) return std::nullopt;
    const Transform candidate = T_w_c.retract(step);
    Normal next;
    if (accumulate(observations, use, candidate, options_.huber, &next) && next.cost <= now.cost) {
      const bool converged = now.cost - next.cost <= kConverged * now.cost;
      T_w_c = candidate;
      now = next;
      lambda = std::max(0.1 * lambda, 1e-9);
      if (converged) break;
    } else {
      lambda *= 10.0;
    }
  }
  return T_w_c;
}

std::optional<PoseSolution> PoseOptimiser::optimise(std::span<const PoseObservation> observations,
                                                    const Transform& guess) const {
  if (observations.empty()) return std::nullopt;
  PoseSolution solution;
  solution.inlier.assign(observations.size(), true);
  std::optional<Transform> pose = minimise(observations, solution.inlier, guess);
  if (!pose) return std::nullopt;

  // Gate each marker against the frame's own noise level, then solve again with those that fit.
  std::vector<double> chi2(observations.size());
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const auto value = markerChi2(observations[i], *pose);
    if (!value) return std::nullopt;
    chi2[i] = *value;
  }
  constexpr double kMedianOfChi2With8 = 7.34;
  if (observations.size() >= 3) {
    const double scale = std::max(1.0, median(chi2) / kMedianOfChi2With8);
    bool changed = false;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      solution.inlier[i] = chi2[i] <= options_.marker_chi2 * scale;
      changed = changed || !solution.inlier[i];
    }
    if (changed) {
      pose = minimise(observations, solution.inlier, *pose);
      if (!pose) return std::nullopt;
    }
  }

  Normal normal;
  if (!accumulate(observations, solution.inlier, *pose, options_.huber, &normal)) {
    return std::nullopt;
  }
  const Eigen::LDLT<Matrix6d> factor(normal.H);
  if (factor.info() != Eigen::Success || !factor.isPositive()) return std::nullopt;
  solution.T_w_c = *pose;

  double squared_px = 0.0;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!solution.inlier[i]) continue;
    ++solution.inliers;
    solution.chi2 += *markerChi2(observations[i], *pose);
    for (std::size_t k = 0; k < 4; ++k) {
      Projection projection;
      (void)projectPoint(*pose, observations[i].corners_w[k], &projection);
      squared_px +=
          (projection.normalised - observations[i].detection->normalised[k]).squaredNorm();
    }
  }
  if (solution.inliers == 0) return std::nullopt;
  solution.rms_px = focal_px_ * std::sqrt(squared_px / (4.0 * solution.inliers));
  const double degrees_of_freedom = 8.0 * solution.inliers - 6.0;
  const double scale = std::max(1.0, solution.chi2 / degrees_of_freedom);
  solution.covariance = scale * factor.solve(Matrix6d::Identity());
  return solution;
}

}  // namespace waymark::slam
