// The derivatives of a marker's four corners by its pose, two rows by corner: rows of P [I,
// -skew(a)], P that by the point (weighted), a from the marker's centre to the corner
// (markerJacobian). All at once, so that sums over the corners are inner products of columns.
#pragma once

#include "slam/geometry/reprojection.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

struct CornerRows {
  Eigen::Matrix<double, 8, 6> J;

  void set(std::size_t corner, const Matrix23d& P, const Eigen::Vector3d& a) {
    const auto row = static_cast<Eigen::Index>(2 * corner);
    for (Eigen::Index i = 0; i < 2; ++i) {
      const Eigen::Vector3d p = P.row(i);
      J.row(row + i) << p.transpose(), a.cross(p).transpose();
    }
  }
  // J^T J.
  [[nodiscard]] Matrix6d square() const {
    Matrix6d H;
    for (int j = 0; j < 6; ++j) {
      for (int i = j; i < 6; ++i) H(i, j) = H(j, i) = J.col(i).dot(J.col(j));
    }
    return H;
  }
  // J^T r.
  [[nodiscard]] Vector6d times(const Eigen::Matrix<double, 8, 1>& r) const {
    Vector6d g;
    for (int i = 0; i < 6; ++i) g[i] = J.col(i).dot(r);
    return g;
  }
  // J_k D J_k^T of a corner's two rows, D symmetric.
  [[nodiscard]] Eigen::Matrix2d spread(std::size_t corner, const Matrix6d& D) const {
    const auto row = static_cast<Eigen::Index>(2 * corner);
    const Vector6d j0 = J.row(row);
    const Vector6d j1 = J.row(row + 1);
    const Vector6d Dj0 = D * j0;
    const Vector6d Dj1 = D * j1;
    const double common = j1.dot(Dj0);
    Eigen::Matrix2d result;
    result << j0.dot(Dj0), common, common, j1.dot(Dj1);
    return result;
  }
};

}  // namespace waymark::slam
