// Rigid transforms and the rotation maths the solvers need.
//
// T_a_b maps points from frame b into frame a: p_a = T_a_b * p_b. Adjacent letters cancel:
// T_w_m = T_w_c * T_c_m. Seed 1, Eq. 1-7, with R and t kept apart instead of a 4x4 matrix.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
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

// Rodrigues' formula (Eq. 2): rotation vector in radians to rotation matrix. By series: the last
// bits of the C library's sine are not the same on all processors, and those of a map are to be.
[[nodiscard]] inline Eigen::Matrix3d expSo3(const Eigen::Vector3d& r) {
  constexpr double kLargest2 = 0.25;  // of the angle, squared, that these are exact to
  // By Horner's scheme: the next term's share of one, last ones first.
  constexpr std::array<double, 7> kSine = {1.0 / 210, 1.0 / 156, 1.0 / 110, 1.0 / 72,
                                           1.0 / 42,  1.0 / 20,  1.0 / 6};
  constexpr std::array<double, 7> kCosine = {1.0 / 240, 1.0 / 182, 1.0 / 132, 1.0 / 90,
                                             1.0 / 56,  1.0 / 30,  1.0 / 12};
  double theta2 = r.squaredNorm();
  int halvings = 0;
  for (; theta2 > kLargest2 && halvings < 64; theta2 *= 0.25) ++halvings;
  double a = 1.0;  // sin(theta) / theta
  double b = 1.0;  // 2 (1 - cos(theta)) / theta^2
  for (std::size_t i = 0; i < kSine.size(); ++i) {
    a = 1.0 - kSine[i] * theta2 * a;
    b = 1.0 - kCosine[i] * theta2 * b;
  }
  const Eigen::Matrix3d K = skew(std::ldexp(1.0, -halvings) * r);
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity() + a * K + 0.5 * b * K * K;
  for (; halvings > 0; --halvings) R = R * R;
  return R;
}

// Inverse of expSo3; the result's norm is in [0, pi]. By a series, too.
[[nodiscard]] inline Eigen::Vector3d logSo3(const Eigen::Matrix3d& R) {
  constexpr double kLargest2 = 0.01;  // of the sine of half the angle, squared
  constexpr std::array<double, 8> kArcsine = {225.0 / 272, 169.0 / 210, 121.0 / 156, 81.0 / 110,
                                              49.0 / 72,   25.0 / 42,   9.0 / 20,    1.0 / 6};
  const Eigen::Quaterniond q = Eigen::Quaterniond(R).normalized();
  Eigen::Vector3d v = std::copysign(1.0, q.w()) * q.vec();
  double w = std::abs(q.w());
  double times = 2.0;
  for (int i = 0; i < 5 && v.squaredNorm() > kLargest2; ++i) {  // of half the angle
    w = std::sqrt(0.5 + 0.5 * w);
    v *= 0.5 / w;
    times *= 2.0;
  }
  double f = 1.0;  // asin(s) / s
  for (const double share : kArcsine) f = 1.0 + share * v.squaredNorm() * f;
  return times * f * v;
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
