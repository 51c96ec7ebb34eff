// Covariances of poses in other axes, at other points, and of their inverses.
#pragma once

#include "slam/geometry/transform.h"

namespace waymark::slam {

// Of (dp, dtheta), in the axes of frame b; R_a_b turns them into those of a. The same of an
// information matrix.
[[nodiscard]] inline Matrix6d turnedCovariance(const Eigen::Matrix3d& R_a_b,
                                               const Matrix6d& covariance) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = R_a_b;
  return turn * covariance * turn.transpose();
}

// Of a rigid body that moves: what (dp, dtheta) at one of its points is at another one, both in the
// world frame. to_from_m: from the first point to the second.
[[nodiscard]] inline Matrix6d rigidTransport(const Eigen::Vector3d& to_from_m) {
  Matrix6d T = Matrix6d::Identity();
  T.topRightCorner<3, 3>() = -skew(to_from_m);
  return T;
}

// Of errors that have nothing in common: standard deviations of each coordinate, metres and
// radians.
[[nodiscard]] inline Matrix6d independentCovariance(double sigma_m, double sigma_rad) {
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(sigma_m * sigma_m),
      Eigen::Vector3d::Constant(sigma_rad * sigma_rad);
  return variances.asDiagonal();
}
[[nodiscard]] inline Matrix6d independentInformation(double sigma_m, double sigma_rad) {
  Vector6d diagonal;
  diagonal << Eigen::Vector3d::Constant(1.0 / (sigma_m * sigma_m)),
      Eigen::Vector3d::Constant(1.0 / (sigma_rad * sigma_rad));
  return diagonal.asDiagonal();
}

// Of (dp, dtheta) of T_a_b^-1, from that of T_a_b. To first order: (R Exp, p + dp) turns the other
// frame by -R^T dtheta, and moves it by -R^T (dp + p x dtheta).
[[nodiscard]] inline Matrix6d covarianceOfInverse(const Transform& T_a_b,
                                                  const Matrix6d& covariance) {
  const Eigen::Matrix3d R_b_a = T_a_b.R.transpose();
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = -R_b_a;
  J.topRightCorner<3, 3>() = -R_b_a * skew(T_a_b.p);
  J.bottomRightCorner<3, 3>() = -R_b_a;
  return J * covariance * J.transpose();
}

}  // namespace waymark::slam
