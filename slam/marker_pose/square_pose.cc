#include "slam/marker_pose/square_pose.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "slam/geometry/homography.h"
#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/reprojection.h"
#include "slam/geometry/rotation.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Rotation that takes the z axis to the direction of (v, 1).
Eigen::Matrix3d rotationToRay(const Eigen::Vector2d& v) {
  return rotationBetween(Eigen::Vector3d::UnitZ(), v.homogeneous().normalized());
}

// The translation that best fits the corners for a given rotation: linear least squares of
// n * (r3 X + tz) - (r12 X + txy) = 0.
Eigen::Vector3d translationFor(const Eigen::Matrix3d& R,
                               const std::array<Eigen::Vector3d, 4>& corners,
                               const std::array<Eigen::Vector2d, 4>& normalized) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector3d x = R * corners[i];
    for (int k = 0; k < 2; ++k) {
      Eigen::Vector3d row = Eigen::Vector3d::Zero();
      row[k] = 1.0;
      row.z() = -normalized[i][k];
      const double rhs = normalized[i][k] * x.z() - x[k];
      A += row * row.transpose();
      b += row * rhs;
    }
  }
  return A.ldlt().solve(b);
}

// IPPE: the two rotations whose image of the plane agrees with the homography to first order at
// the marker's centre.
std::optional<std::array<Eigen::Matrix3d, 2>> ippeRotations(const Eigen::Matrix3d& H) {
  const Eigen::Vector2d v(H(0, 2) / H(2, 2), H(1, 2) / H(2, 2));
  Eigen::Matrix2d J;
  J << H(0, 0) - H(2, 0) * v.x(), H(0, 1) - H(2, 1) * v.x(), H(1, 0) - H(2, 0) * v.y(),
      H(1, 1) - H(2, 1) * v.y();
  J /= H(2, 2);

  const Eigen::Matrix3d R_v = rotationToRay(v);
  Eigen::Matrix<double, 2, 3> P;
  P << 1.0, 0.0, -v.x(), 0.0, 1.0, -v.y();
  const Eigen::Matrix2d B = (P * R_v).leftCols<2>();
  if (!(std::abs(B.determinant()) > 1e-12)) return std::nullopt;  // at least 1 for any number
  const Eigen::Matrix2d A = B.inverse() * J;

  // Largest singular value of A is the inverse depth.
  const Eigen::Matrix2d AAt = A * A.transpose();
  const double mean = 0.5 * AAt.trace();
  const double gamma2 = mean + std::sqrt(std::max(0.0, mean * mean - AAt.determinant()));
  if (!(gamma2 > 0.0)) return std::nullopt;
  const Eigen::Matrix2d R22 = A / std::sqrt(gamma2);

  // Third row (b0, b1) completes the two columns to unit length and orthogonality.
  const Eigen::Matrix2d rest = Eigen::Matrix2d::Identity() - R22.transpose() * R22;
  const double b0 = std::sqrt(std::max(0.0, rest(0, 0)));
  const double b1 = std::copysign(std::sqrt(std::max(0.0, rest(1, 1))), rest(0, 1));
  std::array<Eigen::Matrix3d, 2> rotations;
  for (std::size_t k = 0; k < 2; ++k) {
    const double sign = k == 0 ? 1.0 : -1.0;
    Eigen::Matrix3d R;
    R.col(0) << R22.col(0), sign * b0;
    R.col(1) << R22.col(1), sign * b1;
    R.col(2) = R.col(0).cross(R.col(1));
    rotations[k] = Eigen::Quaterniond(R_v * R).normalized().toRotationMatrix();
  }
  return rotations;
}

// The pose of one marker in the camera frame, refined on the corners' whitened errors.
std::optional<MinimizedPose> refine(const Transform& start,
                                    const std::array<Eigen::Vector3d, 4>& corners,
                                    const MarkerDetection& detection, const WhitenedCorners& W,
                                    int iterations) {
  const Transform camera;  // the identity: the "world" here is the camera
  return minimizePose(start, iterations, [&](const Transform& T_c_m, PoseNormal* normal) {
    for (std::size_t i = 0; i < 4; ++i) {
      const Eigen::Vector3d p = T_c_m * corners[i];
      Projection projection;
      if (!projectPoint(camera, p, &projection)) return false;
      const Eigen::Vector2d r = W[i] * (projection.normalized - detection.normalized[i]);
      const Matrix26d J = W[i] * markerJacobian(T_c_m, p, projection.J_point);
      normal->cost += r.squaredNorm();
      normal->H += J.transpose() * J;
      normal->g += J.transpose() * r;
    }
    return true;
  });
}

// Both IPPE solutions, unrefined.
std::optional<std::array<Transform, 2>> ippePoses(const MarkerDetection& detection, double size_m) {
  const auto from_unit = homographyFromUnitSquare(detection.normalized);
  if (!from_unit) return std::nullopt;
  // Marker coordinates (x right, y up, origin at the centre) to the unit square (v down).
  Eigen::Matrix3d unit_from_marker;
  unit_from_marker << 1.0 / size_m, 0.0, 0.5, 0.0, -1.0 / size_m, 0.5, 0.0, 0.0, 1.0;
  const auto rotations = ippeRotations(*from_unit * unit_from_marker);
  if (!rotations) return std::nullopt;

  const std::array<Eigen::Vector3d, 4> corners = markerCorners(size_m);
  std::array<Transform, 2> poses;
  for (std::size_t k = 0; k < 2; ++k) {
    const Eigen::Matrix3d& R = (*rotations)[k];
    poses[k] = {R, translationFor(R, corners, detection.normalized)};
  }
  return poses;
}

// Where the second solution is no minimum of its own, refinement slides it into the first; the
// unrefined one then stands for the alternative.
bool areSame(const Transform& a, const Transform& b, const SquarePoseOptions& options) {
  return rotationDistance(a.R, b.R) < options.same_rotation_rad;
}

}  // namespace

std::string SquarePoseOptions::invalidReason() const {
  return firstUnmet({
      {isNotNegative(systematic_sigma_px), "the systematic error of a corner must not be negative"},
      {isNotNegative(evidence_floor), "the floor of the evidence must not be negative"},
      {refinement_iterations >= 1, "a square's pose needs at least 1 iteration"},
      {isNotNegative(same_rotation_rad), "the turn of the same solution must not be negative"},
      {isPositive(unseen_chi2), "the chi-square of an unseen marker must be positive"},
  });
}

std::optional<SquarePose> estimateSquarePose(const MarkerDetection& detection, double size_m,
                                             double focal_px, const SquarePoseOptions& options) {
  const auto starts = ippePoses(detection, size_m);
  if (!starts) return std::nullopt;
  const WhitenedCorners W = whitening(detection.covariance);
  const std::array<Eigen::Vector3d, 4> corners = markerCorners(size_m);
  std::array<MinimizedPose, 2> refined;
  for (std::size_t k = 0; k < 2; ++k) {
    const auto found = refine((*starts)[k], corners, detection, W, options.refinement_iterations);
    if (!found) return std::nullopt;
    refined[k] = *found;
  }
  const std::size_t best = refined[0].normal.cost <= refined[1].normal.cost ? 0 : 1;
  const std::size_t other = 1 - best;
  SquarePose pose;
  pose.T_c_m = {refined[best].T, refined[other].T};
  pose.error = {refined[best].normal.cost, refined[other].normal.cost};
  if (areSame(pose.T_c_m[0], pose.T_c_m[1], options)) {
    pose.T_c_m[1] = (*starts)[other];
    pose.error[1] = std::max(pose.error[0], refined[other].start_cost);
  }
  const double floor = comparisonFloor(cornerVariance(detection), focal_px, 1, options);
  pose.ratio = (pose.error[1] + floor) / (pose.error[0] + floor);
  return pose;
}

std::optional<Transform> otherSquarePose(const MarkerDetection& detection, double size_m,
                                         const Transform& T_c_m, const SquarePoseOptions& options) {
  const auto starts = ippePoses(detection, size_m);
  if (!starts) return std::nullopt;
  const auto [a, b] = *starts;
  const Transform& start = rotationDistance(a.R, T_c_m.R) < rotationDistance(b.R, T_c_m.R) ? b : a;
  const auto refined = refine(start, markerCorners(size_m), detection,
                              whitening(detection.covariance), options.refinement_iterations);
  return refined && !areSame(refined->T, T_c_m, options) ? refined->T : start;
}

}  // namespace waymark::slam
