// Steps of a Cholesky factorization by 6x6 blocks beside those of small_cholesky.h.
#pragma once

#include "slam/geometry/transform.h"

namespace waymark::slam {

// B becomes B L^-T. L: a factor of factorizeCholesky.
inline void divideByTransposed(const Matrix6d& L, Matrix6d* B) {
  for (int j = 0; j < 6; ++j) {
    Vector6d column = B->col(j);
    for (int k = 0; k < j; ++k) column -= L(j, k) * B->col(k);
    B->col(j) = L(j, j) * column;
  }
}

// C becomes C - A B^T; it is neither of them. A map's optimization spends most of its time here.
void subtractProduct(const Matrix6d& A, const Matrix6d& B, Matrix6d* C);

// K^T X with K = [I, -skew(d); 0, I]: what (dp, dtheta) of a rigid body at one of its points is at
// another one, d further on (rigidTransport). For symmetric X, the transpose of X K.
template <int Columns>
[[nodiscard]] Eigen::Matrix<double, 6, Columns> transposedTransport(
    const Eigen::Vector3d& d, const Eigen::Matrix<double, 6, Columns>& X) {
  Eigen::Matrix<double, 6, Columns> result = X;
  for (int j = 0; j < Columns; ++j) {
    result.template block<3, 1>(3, j) += d.cross(X.template block<3, 1>(0, j));
  }
  return result;
}

}  // namespace waymark::slam
