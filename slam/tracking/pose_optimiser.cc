#include "slam/tracking/pose_optimiser.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "slam/geometry/reprojection.h"
#include "slam/geometry/robust.h"

namespace waymark::slam {

// Normal equations of Eq. 22 at one pose.
struct PoseOptimiser::Normal {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  double cost = 0.0;  // robust
};

namespace {

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

// Squared whitened residual norm of every corner. False when one is behind the camera.
bool cornerErrors(std::span<const PoseObservation> observations, const Transform& T_w_c,
                  std::vector<double>* squared) {
  for (const PoseObservation& observation : observations) {
    for (std::size_t k = 0; k < 4; ++k) {
      Projection projection;
      if (!projectPoint(T_w_c, observation.corners_w[k], &projection)) return false;
      const Eigen::Matrix2d W = whitening(observation.detection->covariance[k]);
      squared->push_back(
          (W * (projection.normalised - observation.detection->normalised[k])).squaredNorm());
    }
  }
  return true;
}

double sidePx(const MarkerDetection& detection) {
  double perimeter = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    perimeter += (detection.pixels[(k + 1) % 4] - detection.pixels[k]).norm();
  }
  return 0.25 * perimeter;
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

double PoseOptimiser::rmsPx(const PoseObservation& observation, const Transform& T_w_c) const {
  double squared = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    Projection projection;
    if (!projectPoint(T_w_c, observation.corners_w[k], &projection)) return 1e9;  // never an inlier
    squared += (projection.normalised - observation.detection->normalised[k]).squaredNorm();
  }
  return focal_px_ * std::sqrt(0.25 * squared);
}

bool PoseOptimiser::acceptable(const PoseSolution& solution) const {
  const double worst =
      std::max(options_.worst_rms_px, options_.worst_rms_per_side * solution.mean_side_px);
  return solution.rms_px <= worst &&
         2 * solution.inliers >= static_cast<int>(solution.inlier.size());
}

std::optional<Transform> PoseOptimiser::minimise(std::span<const PoseObservation> observations,
                                                 const std::vector<bool>& use, double huber,
                                                 Transform T_w_c) const {
  constexpr double kConverged = 1e-8;  // relative fall of the cost
  constexpr double kHopeless = 1e8;
  Normal now;
  if (!accumulate(observations, use, T_w_c, huber, &now)) return std::nullopt;
  double lambda = 1e-4;
  for (int iteration = 0; iteration < options_.max_iterations && lambda < kHopeless; ++iteration) {
    Matrix6d damped = now.H;
    damped.diagonal() *= 1.0 + lambda;
    const Vector6d step = -damped.ldlt().solve(now.g);
    if (!step.allFinite()) return std::nullopt;
    const Transform candidate = T_w_c.retract(step);
    Normal next;
    if (accumulate(observations, use, candidate, huber, &next) && next.cost <= now.cost) {
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
  std::optional<Transform> pose = minimise(observations, solution.inlier, options_.huber, guess);
  if (!pose) return std::nullopt;

  // The frame's own noise, for the kernel and for the gate.
  std::vector<double> corner_errors;
  corner_errors.reserve(4 * observations.size());
  if (!cornerErrors(observations, *pose, &corner_errors)) return std::nullopt;
  const double noise = noiseScale(corner_errors);
  bool changed = noise > 1.0;
  if (observations.size() >= 3) {
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const double chi2 = *markerChi2(observations[i], *pose);
      solution.inlier[i] = chi2 <= options_.marker_chi2 * noise * noise ||
                           rmsPx(observations[i], *pose) <= options_.inlier_rms_px;
      changed = changed || !solution.inlier[i];
    }
  }
  // Without a majority nobody can say who is wrong: all stay, and the residuals tell the rest.
  if (2 * std::count(solution.inlier.begin(), solution.inlier.end(), true) <
      static_cast<std::ptrdiff_t>(observations.size())) {
    solution.inlier.assign(observations.size(), true);
  }
  if (changed) {
    pose = minimise(observations, solution.inlier, noise * options_.huber, *pose);
    if (!pose) return std::nullopt;
  }

  Normal normal;
  if (!accumulate(observations, solution.inlier, *pose, noise * options_.huber, &normal)) {
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
    const double rms = rmsPx(observations[i], *pose);
    squared_px += rms * rms;
    solution.mean_side_px += sidePx(*observations[i].detection);
  }
  if (solution.inliers == 0) return std::nullopt;
  solution.rms_px = std::sqrt(squared_px / solution.inliers);
  solution.mean_side_px /= solution.inliers;
  const double degrees_of_freedom = 8.0 * solution.inliers - 6.0;
  const double scale = std::max(1.0, solution.chi2 / degrees_of_freedom);
  solution.covariance = scale * factor.solve(Matrix6d::Identity());
  return solution;
}

}  // namespace waymark::slam
