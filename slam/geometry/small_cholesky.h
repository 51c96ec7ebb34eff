// Cholesky's factors of a small symmetric matrix whose size the compiler knows, so that it can lay
// the loops out: an edge fit solves one in every iteration, and a map's optimization is made of
// 6x6 blocks of them.
#pragma once

#include <cmath>

#include <Eigen/Core>

namespace waymark::slam {

// L with L L^T = H, in the lower triangle and in place, its diagonal inverted: "the factor" below.
// False when H is not positive definite. Only its lower triangle is looked at.
template <int N>
[[nodiscard]] bool factorizeCholesky(Eigen::Matrix<double, N, N>* H) {
  Eigen::Matrix<double, N, N>& L = *H;
#pragma GCC unroll 9
  for (int j = 0; j < N; ++j) {
    double pivot = L(j, j);
#pragma GCC unroll 9
    for (int k = 0; k < j; ++k) pivot -= L(j, k) * L(j, k);
    if (!(pivot > 0.0)) return false;
    const double inverse = 1.0 / std::sqrt(pivot);
    L(j, j) = inverse;
#pragma GCC unroll 9
    for (int i = j + 1; i < N; ++i) {
      double sum = L(i, j);
#pragma GCC unroll 9
      for (int k = 0; k < j; ++k) sum -= L(i, k) * L(j, k);
      L(i, j) = sum * inverse;
    }
  }
  return true;
}

// B becomes L^-1 B: a vector, or several beside each other.
template <int N, int Columns>
void solveLower(const Eigen::Matrix<double, N, N>& L, Eigen::Matrix<double, N, Columns>* B) {
#pragma GCC unroll 9
  for (int i = 0; i < N; ++i) {
#pragma GCC unroll 9
    for (int k = 0; k < i; ++k) B->row(i) -= L(i, k) * B->row(k);
    B->row(i) *= L(i, i);
  }
}

// b becomes L^-T b.
template <int N>
void solveLowerTransposed(const Eigen::Matrix<double, N, N>& L, Eigen::Matrix<double, N, 1>* b) {
#pragma GCC unroll 9
  for (int i = N - 1; i >= 0; --i) {
#pragma GCC unroll 9
    for (int k = i + 1; k < N; ++k) (*b)[i] -= L(k, i) * (*b)[k];
    (*b)[i] *= L(i, i);
  }
}

// x of L L^T x = b.
template <int N>
[[nodiscard]] Eigen::Matrix<double, N, 1> solveCholesky(const Eigen::Matrix<double, N, N>& L,
                                                        Eigen::Matrix<double, N, 1> b) {
  solveLower(L, &b);
  solveLowerTransposed(L, &b);
  return b;
}

}  // namespace waymark::slam
