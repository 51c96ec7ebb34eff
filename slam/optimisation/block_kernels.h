// Steps of a Cholesky factorisation by 6x6 blocks, with loops whose size the compiler knows.
#pragma once

#include <cmath>

#include "slam/geometry/transform.h"

namespace waymark::slam {

// Of a positive definite block: the lower triangle L with L L^T = H, its diagonal inverted. In
// place; only the lower triangle is looked at. False when the block is not positive definite.
[[nodiscard]] inline bool factoriseBlock(Matrix6d* H) {
  Matrix6d& L = *H;
  for (int j = 0; j < 6; ++j) {
    double pivot = L(j, j);
    for (int k = 0; k < j; ++k) pivot -= L(j, k) * L(j, k);
    if (!(pivot > 0.0)) return false;
    const double inverse = 1.0 / std::sqrt(pivot);
    L(j, j) = inverse;
    for (int i = j + 1; i < 6; ++i) {
      double sum = L(i, j);
      for (int k = 0; k < j; ++k) sum -= L(i, k) * L(j, k);
      L(i, j) = sum * inverse;
    }
  }
  return true;
}

// B becomes B L^-T. L: as factoriseBlock leaves it, here and below.
inline void divideByTransposed(const Matrix6d& L, Matrix6d* B) {
  for (int j = 0; j < 6; ++j) {
    Vector6d column = B->col(j);
    for (int k = 0; k < j; ++k) column -= L(j, k) * B->col(k);
    B->col(j) = L(j, j) * column;
  }
}

// B becomes L^-1 B; B has six rows.
template <typename Derived>
void divide(const Matrix6d& L, Eigen::MatrixBase<Derived>* B) {
  for (int i = 0; i < 6; ++i) {
    for (int k = 0; k < i; ++k) B->row(i) -= L(i, k) * B->row(k);
    B->row(i) *= L(i, i);
  }
}

// b becomes L^-T b.
inline void divideByTransposed(const Matrix6d& L, Vector6d* b) {
  for (int i = 5; i >= 0; --i) {
    for (int k = i + 1; k < 6; ++k) (*b)[i] -= L(k, i) * (*b)[k];
    (*b)[i] *= L(i, i);
  }
}

// C becomes C - A B^T.
inline void subtractProduct(const Matrix6d& A, const Matrix6d& B, Matrix6d* C) {
  for (int j = 0; j < 6; ++j) {
    Vector6d column = C->col(j);
    for (int k = 0; k < 6; ++k) column -= B(j, k) * A.col(k);
    C->col(j) = column;
  }
}

}  // namespace waymark::slam
