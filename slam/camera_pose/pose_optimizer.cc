#include "slam/camera_pose/pose_optimizer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory_resource>
#include <vector>

#include <Eigen/LU>

#include "base/stack_arena.h"
#include "slam/camera_pose/residual_variance.h"
#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/polygon.h"
#include "slam/geometry/reprojection.h"
#include "slam/geometry/robust.h"
#include "slam/option_checks.h"

namespace waymark::slam {

namespace {

// One frame's problem: markers and their weights. Those of as many as most frames show are on the
// stack.
class FrameProblem {
 public:
  explicit FrameProblem(std::pmr::memory_resource* memory) : whitening_(memory) {}

  // False when a corner is behind the camera.
  bool build(std::span<const KnownMarker> markers, const Transform& T_w_c) {
    markers_ = markers;
    whitening_.resize(markers.size());
    for (std::size_t i = 0; i < markers.size(); ++i) {
      const auto whitening_of = whiteningOf(markers[i], T_w_c);
      if (!whitening_of) return false;
      whitening_[i] = *whitening_of;
    }
    return true;
  }

  // Adds every used corner's share of Eq. 22. False when a used marker is behind the camera.
  bool linearize(const MarkerFlags& use, const Transform& T_w_c, double huber,
                 PoseNormal* normal) const {
    for (std::size_t i = 0; i < markers_.size(); ++i) {
      if (!use[i]) continue;
      for (std::size_t k = 0; k < 4; ++k) {
        Projection projection;
        const Eigen::Vector3d& corner = markers_[i].corners_w[k];
        if (!projectPoint(T_w_c, corner, &projection)) return false;
        const Eigen::Matrix2d& W = whitening_[i][k];
        const Eigen::Vector2d r =
            W * (projection.normalized - markers_[i].detection->normalized[k]);
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

  // Squared whitened residual norms of a marker's corners, appended. False behind the camera.
  bool cornerErrors(std::size_t i, const Transform& T_w_c,
                    std::pmr::vector<double>* squared) const {
    for (std::size_t k = 0; k < 4; ++k) {
      const auto error = squaredError(T_w_c, markers_[i].corners_w[k],
                                      markers_[i].detection->normalized[k], whitening_[i][k]);
      if (!error) return false;
      squared->push_back(*error);
    }
    return true;
  }

 private:
  std::span<const KnownMarker> markers_;
  std::pmr::vector<WhitenedCorners> whitening_;
};

}  // namespace

std::optional<WhitenedCorners> whiteningOf(const KnownMarker& marker, const Transform& T_w_c) {
  constexpr double kShared = 4.0;  // corners
  WhitenedCorners whitening_of;
  for (std::size_t k = 0; k < 4; ++k) {
    Projection projection;
    if (!projectPoint(T_w_c, marker.corners_w[k], &projection)) return std::nullopt;
    const Matrix26d J = markerJacobian(marker.T_w_m, marker.corners_w[k], projection.J_point);
    whitening_of[k] = whitening(marker.detection->covariance[k] +
                                kShared * J * marker.covariance * J.transpose());
  }
  return whitening_of;
}

std::string PoseOptimizerOptions::invalidReason() const {
  return firstUnmet({
      {max_iterations >= 1, "a camera's pose needs at least 1 iteration"},
      {isPositive(huber), "Huber's threshold must be positive"},
      {isPositive(marker_chi2), "the chi-square of a marker must be positive"},
      {min_gated_markers >= 3, "the gate of markers needs at least 3 of them"},
      {isNotNegative(inlier_rms_px), "the residuals of a marker that fits must not be negative"},
      {isPositive(max_rms_px) && isNotNegative(max_rms_per_side),
       "the largest residuals of a pose must be positive"},
      {isShare(min_inlier_share), "the share of markers that fit must be from 0 to 1"},
  });
}

PoseOptimizer::PoseOptimizer(double focal_px, const PoseOptimizerOptions& options)
    : focal_px_(focal_px), options_(options) {}

std::optional<double> PoseOptimizer::markerChi2(const KnownMarker& marker, const Transform& T_w_c) {
  const auto whitening_of = whiteningOf(marker, T_w_c);
  if (!whitening_of) return std::nullopt;
  double chi2 = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto squared = squaredError(T_w_c, marker.corners_w[k], marker.detection->normalized[k],
                                      (*whitening_of)[k]);
    if (!squared) return std::nullopt;
    chi2 += *squared;
  }
  return chi2;
}

bool PoseOptimizer::explains(const KnownMarker& marker, const Transform& T_w_c,
                             double residual_sigma) const {
  const auto chi2 = markerChi2(marker, T_w_c);
  return chi2 && *chi2 <= options_.marker_chi2 * residual_sigma * residual_sigma;
}

double PoseOptimizer::sidePx(const MarkerDetection& detection) {
  return meanSide(detection.pixels);
}

double PoseOptimizer::rmsPx(const KnownMarker& marker, const Transform& T_w_c) const {
  double squared = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto error = squaredError(T_w_c, marker.corners_w[k], marker.detection->normalized[k]);
    if (!error) return std::numeric_limits<double>::infinity();
    squared += *error;
  }
  return focal_px_ * std::sqrt(0.25 * squared);
}

bool PoseOptimizer::areEnough(std::size_t inliers, std::size_t markers) const {
  return static_cast<double>(inliers) >= options_.min_inlier_share * static_cast<double>(markers);
}

bool PoseOptimizer::acceptable(const PoseSolution& solution) const {
  return solution.rms_px <= maxRmsPx(solution.mean_side_px) &&
         areEnough(static_cast<std::size_t>(solution.inliers), solution.inlier.size());
}

std::optional<PoseSolution> PoseOptimizer::optimize(std::span<const KnownMarker> markers,
                                                    const Transform& guess) const {
  if (markers.empty()) return std::nullopt;
  StackArena<16384> arena;
  FrameProblem problem(arena.get());
  if (!problem.build(markers, guess)) return std::nullopt;
  PoseSolution solution;
  solution.inlier.assign(markers.size(), true);
  const auto minimize = [&](const Transform& start, double huber) {
    return minimizePose(start, options_.max_iterations,
                        [&](const Transform& T_w_c, PoseNormal* normal) {
                          return problem.linearize(solution.inlier, T_w_c, huber, normal);
                        });
  };
  std::optional<MinimizedPose> minimum = minimize(guess, options_.huber);
  if (!minimum) return std::nullopt;

  // The frame's own noise, for the kernel and for the gate.
  std::pmr::vector<double> corner_errors(arena.get());
  corner_errors.reserve(4 * markers.size());
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!problem.cornerErrors(i, minimum->T, &corner_errors)) return std::nullopt;
  }
  const double residual_sigma = residualSigmaOf(corner_errors);
  bool changed = residual_sigma > 1.0;
  if (static_cast<int>(markers.size()) >= options_.min_gated_markers) {
    for (std::size_t i = 0; i < markers.size(); ++i) {
      const double* squared = corner_errors.data() + 4 * i;
      const double chi2 = squared[0] + squared[1] + squared[2] + squared[3];
      const bool fits = chi2 <= options_.marker_chi2 * residual_sigma * residual_sigma ||
                        rmsPx(markers[i], minimum->T) <= options_.inlier_rms_px;
      solution.inlier.set(i, fits);
      changed = changed || !fits;
    }
  }
  // Nobody can say who is wrong: all stay, and the residuals tell the rest.
  if (!areEnough(solution.inlier.count(), markers.size())) {
    solution.inlier.assign(markers.size(), true);
  }
  if (changed) {
    minimum = minimize(minimum->T, residual_sigma * options_.huber);
    if (!minimum) return std::nullopt;
  }

  const auto covariance = inverseOf(minimum->normal.H);
  if (!covariance) return std::nullopt;
  solution.T_w_c = minimum->T;
  double squared_px = 0.0;
  std::pmr::vector<double> squared(arena.get());
  squared.reserve(4 * markers.size());
  for (std::size_t i = 0; i < markers.size(); ++i) {
    if (!solution.inlier[i]) continue;
    ++solution.inliers;
    if (!problem.cornerErrors(i, solution.T_w_c, &squared)) return std::nullopt;
    const double rms = rmsPx(markers[i], solution.T_w_c);
    squared_px += rms * rms;
    solution.mean_side_px += sidePx(*markers[i].detection);
  }
  if (solution.inliers == 0) return std::nullopt;
  for (const double error : squared) solution.chi2 += error;
  solution.rms_px = std::sqrt(squared_px / solution.inliers);
  solution.mean_side_px /= solution.inliers;
  solution.covariance = *covariance;
  solution.widenTo(unexplainedVariance(solution.chi2, solution.degreesOfFreedom()));
  return solution;
}

}  // namespace waymark::slam
