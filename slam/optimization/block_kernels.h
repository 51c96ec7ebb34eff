// Steps of a Cholesky factorization by 6x6 blocks beside those of small_cholesky.h. A map's
// optimization spends most of its time in the first two: they are there in several forms, and the
// fastest that the processor can run is taken when the program starts.
#pragma once

#include <span>

#include "slam/geometry/transform.h"

namespace waymark::slam {

// B becomes B L^-T. L: a factor of factorizeCholesky.
void divideByTransposed(const Matrix6d& L, Matrix6d* B);

// C becomes C - A B^T.
void subtractProduct(const Matrix6d& A, const Matrix6d& B, Matrix6d* C);

// Forms of these two, for processors of one kind. All round alike: a recording gives the same map
// on each of them. (So nothing is fused on x86-64, where the least one cannot.)
struct BlockKernels {
  const char* name = nullptr;
  void (*divide_by_transposed)(const Matrix6d& L, Matrix6d* B) = nullptr;
  void (*subtract_product)(const Matrix6d& A, const Matrix6d& B, Matrix6d* C) = nullptr;
};

// Those that this processor can run; the portable one first, the one that is taken last.
[[nodiscard]] std::span<const BlockKernels> runnableBlockKernels() noexcept;

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
