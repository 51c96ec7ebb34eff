// Cholesky's factors of a small symmetric matrix whose size the compiler knows, so that it can lay
// the loops out: an edge fit solves one in every iteration.
#pragma once

#include <cmath>

#include <Eigen/Core>

namespace waymark::slam {

template <int N>
class SmallCholesky {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;
  using Matrix = Eigen::Matrix<double, N, N>;

  // False when H is not positive definite. Only its lower triangle is looked at.
  [[nodiscard]] bool factorise(const Matrix& H) {
#pragma GCC unroll 8
    for (int j = 0; j < N; ++j) {
      double pivot = H(j, j);
#pragma GCC unroll 8
      for (int k = 0; k < j; ++k) pivot -= L_(j, k) * L_(j, k);
      if (!(pivot > 0.0)) return false;
      const double root = std::sqrt(pivot);
      inverse_[j] = 1.0 / root;
#pragma GCC unroll 8
      for (int i = j + 1; i < N; ++i) {
        double sum = H(i, j);
#pragma GCC unroll 8
        for (int k = 0; k < j; ++k) sum -= L_(i, k) * L_(j, k);
        L_(i, j) = sum * inverse_[j];
      }
    }
    return true;
  }

  // x of H x = b. Precondition: the last factorise() succeeded.
  [[nodiscard]] Vector solve(const Vector& b) const {
    Vector x = b;
#pragma GCC unroll 8
    for (int i = 0; i < N; ++i) {
#pragma GCC unroll 8
      for (int k = 0; k < i; ++k) x[i] -= L_(i, k) * x[k];
      x[i] *= inverse_[i];
    }
#pragma GCC unroll 8
    for (int i = N - 1; i >= 0; --i) {
#pragma GCC unroll 8
      for (int k = i + 1; k < N; ++k) x[i] -= L_(k, i) * x[k];
      x[i] *= inverse_[i];
    }
    return x;
  }

 private:
  Matrix L_ = Matrix::Zero();        // below the diagonal
  Vector inverse_ = Vector::Zero();  // of the diagonal
};

}  // namespace waymark::slam
