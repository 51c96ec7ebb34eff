#include "slam/tracking/pose_optimiser.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "slam/geometry/minimise_pose.h"
#include "slam/geometry/reprojection.h"
#include "slam/geometry/robust.h"

namespace waymark::slam {

namespace {

// Adds every used corner's share of Eq. 22. False when a used marker is behind the camera.
bool linearise(std::span<const PoseObservation> observations, const std::vector<bool>& use,
               const Transform& T_w_c, double huber, PoseNormal* normal) {
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
      const double weight = huberWeight(squared, huber);
      const Matrix26d J = W * cameraJacobian(T_w_c, corner, projection.J_point);
      normal->cost += huberCost(squared, huber);
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

std::optional<PoseSolution> PoseOptimiser::optimise(std::span<const PoseObservation> observations,
                                                    const Transform& guess) const {
  if (observations.empty()) return std::nullopt;
  PoseSolution solution;
  solution.inlier.assign(observations.size(), true);
  const auto minimise = [&](const Transform& start, double huber) {
    return minimisePose(start, options_.max_iterations,
                        [&](const Transform& T_w_c, PoseNormal* normal) {
                          return linearise(observations, solution.inlier, T_w_c, huber, normal);
                        });
  };
  std::optional<MinimisedPose> minimum = minimise(guess, options_.huber);
  if (!minimum) return std::nullopt;

  // The frame's own noise, for the kernel and for the gate.
  std::vector<double> corner_errors;
  corner_errors.reserve(4 * observations.size());
  if (!cornerErrors(observations, minimum->T, &corner_errors)) return std::nullopt;
  const double noise = noiseScale(corner_errors);
  bool changed = noise > 1.0;
  if (observations.size() >= 3) {
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const double chi2 = *markerChi2(observations[i], minimum->T);
      solution.inlier[i] = chi2 <= options_.marker_chi2 * noise * noise ||
                           rmsPx(observations[i], minimum->T) <= options_.inlier_rms_px;
      changed = changed || !solution.inlier[i];
    }
  }
  // Without a majority nobody can say who is wrong: all stay, and the residuals tell the rest.
  if (2 * std::count(solution.inlier.begin(), solution.inlier.end(), true) <
      static_cast<std::ptrdiff_t>(observations.size())) {
    solution.inlier.assign(observations.size(), true);
  }
  if (changed) {
    minimum = minimise(minimum->T, noise * options_.huber);
    if (!minimum) return std::nullopt;
  }

  const Eigen::LDLT<Matrix6d> factor(minimum->normal.H);
  if (factor.info() != Eigen::Success || !factor.isPositive()) return std::nullopt;
  solution.T_w_c = minimum->T;
  double squared_px = 0.0;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!solution.inlier[i]) continue;
    ++solution.inliers;
    solution.chi2 += *markerChi2(observations[i], solution.T_w_c);
    const double rms = rmsPx(observations[i], solution.T_w_c);
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
