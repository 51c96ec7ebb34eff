#include "slam/marker_pose/square_pose.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "slam/geometry/homography.h"
#include "slam/geometry/reprojection.h"

namespace waymark::slam {
namespace {

// Rotation that takes the z axis to the direction of (v, 1).
Eigen::Matrix3d rotationToRay(const Eigen::Vector2d& v) {
  return Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), v.homogeneous().normalized())
      .toRotationMatrix();
}

// The translation that best fits the corners for a given rotation: linear least squares of
// n * (r3 X + tz) - (r12 X + txy) = 0.
Eigen::Vector3d translationFor(const Eigen::Matrix3d& R,
                               const std::array<Eigen::Vector3d, 4>& corners,
                               const std::array<Eigen::Vector2d, 4>& normalised) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector3d x = R * corners[i];
    for (int k = 0; k < 2; ++k) {
      Eigen::Vector3d row = Eigen::Vector3d::Zero();
      row[k] = 1.0;
      row.z() = -normalised[i][k];
      const double rhs = normalised[i][k] * x.z() - x[k];
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
  if (!(std::abs(B.determinant()) > 1e-12)) return std::nullopt;
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

struct Refined {
  Transform T_c_m;
  double error;
  Transform start;
  double start_error;
};

// Gauss-Newton with step halving on the pose of one marker in the camera frame.
std::optional<Refined> refine(Transform T_c_m, const std::array<Eigen::Vector3d, 4>& corners,
                              const MarkerDetection& detection,
                              const std::array<Eigen::Matrix2d, 4>& W, int iterations) {
  const Transform camera;  // the identity: the "world" here is the camera
  const auto evaluate = [&](const Transform& T, Matrix6d* H, Vector6d* g) -> std::optional<double> {
    double error = 0.0;
    for (std::size_t i = 0; i < 4; ++i) {
      const Eigen::Vector3d p = T * corners[i];
      Projection projection;
      if (!projectPoint(camera, p, &projection)) return std::nullopt;
      const Eigen::Vector2d r = W[i] * (projection.normalised - detection.normalised[i]);
      error += r.squaredNorm();
      if (H != nullptr) {
        const Matrix26d J = W[i] * markerJacobian(T, p, projection.J_point);
        *H += J.transpose() * J;
        *g += J.transpose() * r;
      }
    }
    return error;
  };

  double lambda = 1e-6;
  const Transform start = T_c_m;
  const std::optional<double> start_error = evaluate(T_c_m, nullptr, nullptr);
  if (!start_error) return std::nullopt;
  std::optional<double> error = start_error;
  for (int k = 0; k < iterations; ++k) {
    Matrix6d H = Matrix6d::Zero();
    Vector6d g = Vector6d::Zero();
    (void)evaluate(T_c_m, &H, &g);
    H.diagonal() *= 1.0 + lambda;
    const Vector6d step = -H.ldlt().solve(g);
    if (!step.allFinite()) break;
    const Transform candidate = T_c_m.retract(step);
    const std::optional<double> next = evaluate(candidate, nullptr, nullptr);
    if (next && *next < *error) {
      const bool converged = *error - *next < 1e-9 * (*error + 1e-9);
      T_c_m = candidate;
      error = next;
      lambda = std::max(lambda * 0.1, 1e-9);
      if (converged) break;
    } else {
      lambda = std::max(lambda * 100.0, 1e-4);
      if (lambda > 1e6) break;
    }
  }
  return Refined{T_c_m, *error, start, *start_error};
}

}  // namespace

std::optional<SquarePose> estimateSquarePose(const MarkerDetection& detection, double size_m,
                                             double focal_px, const SquarePoseOptions& options) {
  const auto from_unit = homographyFromUnitSquare(detection.normalised);
  if (!from_unit) return std::nullopt;
  // Marker coordinates (x right, y up, origin at the centre) to the unit square (v down).
  Eigen::Matrix3d unit_from_marker;
  unit_from_marker << 1.0 / size_m, 0.0, 0.5, 0.0, -1.0 / size_m, 0.5, 0.0, 0.0, 1.0;
  const auto rotations = ippeRotations(*from_unit * unit_from_marker);
  if (!rotations) return std::nullopt;

  std::array<Eigen::Matrix2d, 4> W;
  double corner_variance = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    W[i] = whitening(detection.covariance[i]);
    corner_variance += detection.covariance[i].trace() / 8.0;
  }
  const std::array<Eigen::Vector3d, 4> corners = markerCorners(size_m);
  std::array<std::optional<Refined>, 2> refined;
  for (std::size_t k = 0; k < 2; ++k) {
    const Eigen::Matrix3d& R = (*rotations)[k];
    const Transform start{R, translationFor(R, corners, detection.normalised)};
    refined[k] = refine(start, corners, detection, W, options.refinement_iterations);
  }
  if (!refined[0] || !refined[1]) return std::nullopt;
  if (refined[1]->error < refined[0]->error) std::swap(refined[0], refined[1]);

  // Where the second solution is no minimum of its own, refinement slides it into the first; the
  // unrefined one then stands for the alternative.
  constexpr double kSameRotation = 0.01;  // radians
  if (rotationDistance(refined[0]->T_c_m.R, refined[1]->T_c_m.R) < kSameRotation) {
    refined[1]->T_c_m = refined[1]->start;
    refined[1]->error = std::max(refined[0]->error, refined[1]->start_error);
  }

  SquarePose pose;
  for (std::size_t k = 0; k < 2; ++k) {
    pose.T_c_m[k] = refined[k]->T_c_m;
    pose.error[k] = refined[k]->error;
  }
  // Both errors were whitened by the corners' covariance; the systematic part adds to the variance,
  // and two degrees of freedom are left for it to show in.
  const double systematic = options.systematic_sigma_px / focal_px;
  const double floor = 2.0 * systematic * systematic / corner_variance;
  pose.ratio = (pose.error[1] + floor) / (pose.error[0] + floor);
  return pose;
}

}  // namespace waymark::slam
