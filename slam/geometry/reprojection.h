// The reprojection residual every solver here minimizes (seed 1, Eq. 11), with its Jacobians.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include <Eigen/Core>

#include "slam/geometry/transform.h"

namespace waymark::slam {

using Matrix26d = Eigen::Matrix<double, 2, 6>;
using Matrix23d = Eigen::Matrix<double, 2, 3>;

// W with W^T W = covariance^-1, so that W * residual has unit covariance.
[[nodiscard]] inline Eigen::Matrix2d whitening(const Eigen::Matrix2d& covariance) {
  // Cholesky factor of a 2x2 matrix, written out and inverted.
  const double a = std::sqrt(covariance(0, 0));
  const double b = covariance(1, 0) / a;
  const double c = std::sqrt(std::max(covariance(1, 1) - b * b, 1e-300));
  Eigen::Matrix2d W;
  W << 1.0 / a, 0.0, -b / (a * c), 1.0 / c;
  return W;
}

// Of a marker's four corners.
using WhitenedCorners = std::array<Eigen::Matrix2d, 4>;
[[nodiscard]] inline WhitenedCorners whitening(const std::array<Eigen::Matrix2d, 4>& covariances) {
  WhitenedCorners W;
  for (std::size_t k = 0; k < 4; ++k) W[k] = whitening(covariances[k]);
  return W;
}

// Points nearer than this to the camera plane, or behind it, are not projected, metres.
inline constexpr double kNearestDepth = 1e-3;

// d normalized / d point in the world, of a point at p_c in the camera's frame.
[[nodiscard]] inline Matrix23d projectionJacobian(const Transform& T_w_c,
                                                  const Eigen::Vector3d& p_c) {
  const double iz = 1.0 / p_c.z();
  const double x = p_c.x() * iz * iz;
  const double y = p_c.y() * iz * iz;
  Matrix23d J;
  J.row(0) = (iz * T_w_c.R.col(0) - x * T_w_c.R.col(2)).transpose();
  J.row(1) = (iz * T_w_c.R.col(1) - y * T_w_c.R.col(2)).transpose();
  return J;
}

struct Projection {
  Eigen::Vector2d normalized;
  Matrix23d J_point;  // by the point in the world
};

// Projects a world point; false when it is not in front of the camera.
[[nodiscard]] inline bool projectPoint(const Transform& T_w_c, const Eigen::Vector3d& p_w,
                                       Projection* out) {
  const Eigen::Vector3d p_c = T_w_c.R.transpose() * (p_w - T_w_c.p);
  if (p_c.z() < kNearestDepth) return false;
  out->normalized = p_c.head<2>() / p_c.z();
  out->J_point = projectionJacobian(T_w_c, p_c);
  return true;
}

// |W (projection - seen)|^2 of a corner (Eq. 11). Empty when it is not in front of the camera.
[[nodiscard]] inline std::optional<double> squaredError(
    const Transform& T_w_c, const Eigen::Vector3d& p_w, const Eigen::Vector2d& seen,
    const Eigen::Matrix2d& W = Eigen::Matrix2d::Identity()) {
  const Eigen::Vector3d p_c = T_w_c.R.transpose() * (p_w - T_w_c.p);
  if (p_c.z() < kNearestDepth) return std::nullopt;
  return (W * (p_c.head<2>() / p_c.z() - seen)).squaredNorm();
}

// d normalized / d delta of T_w_c (Transform::retract), from the point's Jacobian.
[[nodiscard]] inline Matrix26d cameraJacobian(const Transform& T_w_c, const Eigen::Vector3d& p_w,
                                              const Matrix23d& J_point) {
  Matrix26d J;
  J.leftCols<3>() = -J_point;
  J.rightCols<3>() = J_point * skew(p_w - T_w_c.p);
  return J;
}

// d normalized / d delta of T_w_m, for a corner at p_w.
[[nodiscard]] inline Matrix26d markerJacobian(const Transform& T_w_m, const Eigen::Vector3d& p_w,
                                              const Matrix23d& J_point) {
  Matrix26d J;
  J.leftCols<3>() = J_point;
  J.rightCols<3>() = -J_point * skew(p_w - T_w_m.p);
  return J;
}

}  // namespace waymark::slam
