// Rigid transforms and the rotation maths the solvers need.
//
// T_a_b maps points from frame b into frame a: p_a = T_a_b * p_b. Adjacent letters cancel:
// T_w_m = T_w_c * T_c_m. Seed 1, Eq. 1-7, with R and t kept apart instead of a 4x4 matrix.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace waymark::slam {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

[[nodiscard]] inline Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

// Rodrigues' formula (Eq. 2): rotation vector in radians to rotation matrix.
[[nodiscard]] inline Eigen::Matrix3d expSo3(const Eigen::Vector3d& r) {
  const double theta2 = r.squaredNorm();
  const Eigen::Matrix3d K = skew(r);
  double a = 1.0 - theta2 / 6.0;   // sin(theta) / theta
  double b = 0.5 - theta2 / 24.0;  // (1 - cos(theta)) / theta^2
  if (theta2 > 1e-8) {
    const double theta = std::sqrt(theta2);
    a = std::sin(theta) / theta;
    b = (1.0 - std::cos(theta)) / theta2;
  }
  return Eigen::Matrix3d::Identity() + a * K + b * K * K;
}

// Inverse of expSo3; the result's norm is in [0, pi].
[[nodiscard]] inline Eigen::Vector3d logSo3(const Eigen::Matrix3d& R) {
  const Eigen::Quaterniond q = Eigen::Quaterniond(R).normalized();
  const double s = q.vec().norm();
  const double angle = 2.0 * std::atan2(s, std::abs(q.w()));
  const double scale = s > 1e-12 ? angle / s : 2.0;
  return (q.w() < 0.0 ? -scale : scale) * q.vec();
}

struct Transform {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p = Eigen::Vector3d::Zero();  // metres

  [[nodiscard]] Transform inverse() const { return {R.transpose(), -(R.transpose() * p)}; }
  [[nodiscard]] Transform operator*(const Transform& o) const { return {R * o.R, R * o.p + p}; }
  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& x) const { return R * x + p; }
  [[nodiscard]] Eigen::Quaterniond quaternion() const {
    Eigen::Quaterniond q(R);
    q.normalize();
    if (q.w() < 0.0) q.coeffs() = -q.coeffs();
    return q;
  }

  // The solvers' local coordinates, for T_a_b: delta = (dp, dtheta), both expressed in frame a;
  // p' = p + dp, R' = Exp(dtheta) R. Covariances are published in the same coordinates.
  [[nodiscard]] Transform retract(const Vector6d& delta) const {
    Transform t;
    t.R = Eigen::Quaterniond(expSo3(delta.tail<3>()) * R).normalized().toRotationMatrix();
    t.p = p + delta.head<3>();
    return t;
  }

  // The delta for which retract(delta) gives `other`.
  [[nodiscard]] Vector6d localCoordinates(const Transform& other) const {
    Vector6d d;
    d.head<3>() = other.p - p;
    d.tail<3>() = logSo3(other.R * R.transpose());
    return d;
  }

  [[nodiscard]] static Transform fromQuaternion(const Eigen::Quaterniond& q,
                                                const Eigen::Vector3d& p) {
    return {q.normalized().toRotationMatrix(), p};
  }
};

// Angle between two orientations, in radians, in [0, pi].
[[nodiscard]] inline double rotationDistance(const Eigen::Matrix3d& A, const Eigen::Matrix3d& B) {
  // The chord between them: |A - B| = 2 sqrt(2) sin(angle / 2).
  return 2.0 * std::asin(std::min(1.0, (A - B).norm() / (2.0 * std::numbers::sqrt2)));
}

}  // namespace waymark::slam
