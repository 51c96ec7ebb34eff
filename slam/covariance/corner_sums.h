// Sums over a marker's corners of J^T S J and J^T v, J the corner's Jacobian by its marker's pose
// (markerJacobian): J = P [I, -skew(a)], P that by the point, a from the marker's centre to the
// corner. So the sums are made of 3x3 blocks.
#pragma once

#include "slam/geometry/reprojection.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

// Adds J^T S J, S symmetric, to the upper triangle of blocks of `sum`.
inline void addSquare(const Matrix23d& P, const Eigen::Vector3d& a, const Eigen::Matrix2d& S,
                      Matrix6d* sum) {
  const Eigen::Vector3d p0 = P.row(0);
  const Eigen::Vector3d p1 = P.row(1);
  const Eigen::Vector3d q0 = S(0, 0) * p0 + S(0, 1) * p1;
  const Eigen::Vector3d q1 = S(0, 1) * p0 + S(1, 1) * p1;
  for (int j = 0; j < 3; ++j) {
    const Eigen::Vector3d column = p0 * q0[j] + p1 * q1[j];  // of P^T S P, and its row j
    sum->block<3, 1>(0, j) += column;
    sum->block<1, 3>(j, 3) += a.cross(column).transpose();
  }
  // J = P [I, -skew(a)]: the rows of its right half are a x p.
  const Eigen::Vector3d t0 = a.cross(p0);
  const Eigen::Vector3d t1 = a.cross(p1);
  const Eigen::Vector3d s0 = S(0, 0) * t0 + S(0, 1) * t1;
  const Eigen::Vector3d s1 = S(0, 1) * t0 + S(1, 1) * t1;
  for (int j = 0; j < 3; ++j) sum->block<3, 1>(3, 3 + j) += t0 * s0[j] + t1 * s1[j];
}

// After the last corner: the lower triangle as the upper one.
inline void mirror(Matrix6d* sum) {
  sum->bottomLeftCorner<3, 3>() = sum->topRightCorner<3, 3>().transpose();
}

// J^T v.
[[nodiscard]] inline Vector6d transposedJacobianTimes(const Matrix23d& P, const Eigen::Vector3d& a,
                                                      const Eigen::Vector2d& v) {
  const Eigen::Vector3d u = P.transpose() * v;
  Vector6d result;
  result << u, a.cross(u);
  return result;
}

// J D J^T, D symmetric.
[[nodiscard]] inline Eigen::Matrix2d spreadOfCorner(const Matrix23d& P, const Eigen::Vector3d& a,
                                                    const Matrix6d& D) {
  Vector6d j0;
  Vector6d j1;
  j0 << P.row(0).transpose(), a.cross(P.row(0).transpose());
  j1 << P.row(1).transpose(), a.cross(P.row(1).transpose());
  const Vector6d Dj0 = D * j0;
  const double common = j1.dot(Dj0);
  Eigen::Matrix2d result;
  result << j0.dot(Dj0), common, common, j1.dot(D * j1);
  return result;
}

}  // namespace waymark::slam
