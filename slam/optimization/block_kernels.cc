#include "slam/optimization/block_kernels.h"

#include <array>

#include "base/vectorized.h"

namespace waymark::slam {
namespace {

constexpr int kRows = 6;

// By columns, as the matrices lie in memory.
WAYMARK_VECTORIZED void subtractColumns(const double* __restrict A, const double* __restrict B,
                                        double* __restrict C) {
  for (int j = 0; j < kRows; ++j) {
    std::array<double, kRows> column;
    for (int i = 0; i < kRows; ++i) column[i] = C[kRows * j + i];
    for (int k = 0; k < kRows; ++k) {
      const double factor = B[kRows * k + j];
      for (int i = 0; i < kRows; ++i) column[i] -= factor * A[kRows * k + i];
    }
    for (int i = 0; i < kRows; ++i) C[kRows * j + i] = column[i];
  }
}

}  // namespace

void subtractProduct(const Matrix6d& A, const Matrix6d& B, Matrix6d* C) {
  subtractColumns(A.data(), B.data(), C->data());
}

}  // namespace waymark::slam
