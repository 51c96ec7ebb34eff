// Errors of poses as the filter keeps them: motions of the world, T = Exp(xi) * T_estimated, with
// xi = (translation, rotation) in metres and radians, both in the world frame ("right-invariant").
//
// Transform::retract's (dp, dtheta) moves the camera about itself instead: dp = xi_p + theta x p.
#pragma once

#include <cmath>

#include "slam/geometry/transform.h"

namespace waymark::slam {

// Integral of Exp(s r) over s = 0 .. 1: how a translation is bent by the rotation it comes with.
[[nodiscard]] inline Eigen::Matrix3d leftJacobianSo3(const Eigen::Vector3d& r) {
  const double theta2 = r.squaredNorm();
  const Eigen::Matrix3d K = skew(r);
  double a = 0.5 - theta2 / 24.0;         // (1 - cos(theta)) / theta^2
  double b = 1.0 / 6.0 - theta2 / 120.0;  // (theta - sin(theta)) / theta^3
  if (theta2 > 1e-6) {
    const double theta = std::sqrt(theta2);
    a = (1.0 - std::cos(theta)) / theta2;
    b = (theta - std::sin(theta)) / (theta2 * theta);
  }
  return Eigen::Matrix3d::Identity() + a * K + b * K * K;
}

// The same of Exp(-r) = Exp(r)^T: body-frame rotation rates into the body's frame.
[[nodiscard]] inline Eigen::Matrix3d rightJacobianSo3(const Eigen::Vector3d& r) {
  return leftJacobianSo3(-r);
}

[[nodiscard]] inline Transform expSe3(const Vector6d& xi) {
  return {expSo3(xi.tail<3>()), leftJacobianSo3(xi.tail<3>()) * xi.head<3>()};
}

// Inverse of expSe3 for rotations below pi.
[[nodiscard]] inline Vector6d logSe3(const Transform& T) {
  Vector6d xi;
  xi.tail<3>() = logSo3(T.R);
  const Eigen::Vector3d r = xi.tail<3>();
  const double theta2 = r.squaredNorm();
  const Eigen::Matrix3d K = skew(r);
  double c = 1.0 / 12.0 + theta2 / 720.0;
  if (theta2 > 1e-6) {
    const double theta = std::sqrt(theta2);
    c = 1.0 / theta2 - (1.0 + std::cos(theta)) / (2.0 * theta * std::sin(theta));
  }
  xi.head<3>() = T.p - 0.5 * r.cross(T.p) + c * (K * (K * T.p));
  return xi;
}

// xi in frame a of the same motion given as xi in frame b: T_a_b Exp(xi_b) T_b_a = Exp(Ad xi_b).
[[nodiscard]] inline Matrix6d adjoint(const Transform& T_a_b) {
  Matrix6d A;
  A << T_a_b.R, skew(T_a_b.p) * T_a_b.R, Eigen::Matrix3d::Zero(), T_a_b.R;
  return A;
}

// (dp, dtheta) of Transform::retract from xi, of a pose at p (metres, in the world).
[[nodiscard]] inline Matrix6d retractFromInvariant(const Eigen::Vector3d& p) {
  Matrix6d A = Matrix6d::Identity();
  A.topRightCorner<3, 3>() = -skew(p);
  return A;
}
// And back.
[[nodiscard]] inline Matrix6d invariantFromRetract(const Eigen::Vector3d& p) {
  Matrix6d A = Matrix6d::Identity();
  A.topRightCorner<3, 3>() = skew(p);
  return A;
}

}  // namespace waymark::slam
