#include "slam/optimization/block_kernels.h"

#include <array>

namespace waymark::slam {
namespace {

// By columns, which the compiler lays out for the least processor of its kind: SSE2, or NEON with
// fused multiply-adds.
void dividePortably(const Matrix6d& L, Matrix6d* B) {
  for (int j = 0; j < 6; ++j) {
    Vector6d column = B->col(j);
    for (int k = 0; k < j; ++k) column -= L(j, k) * B->col(k);
    B->col(j) = L(j, j) * column;
  }
}

void subtractPortably(const Matrix6d& A, const Matrix6d& B, Matrix6d* C) {
  for (int j = 0; j < 6; ++j) {
    Vector6d column = C->col(j);
    for (int k = 0; k < 6; ++k) column -= B(j, k) * A.col(k);
    C->col(j) = column;
  }
}

constexpr BlockKernels kPortable{"portable", dividePortably, subtractPortably};

#if defined(__x86_64__)

// A column in two registers: its first four elements, and the last two.
using Four = double __attribute__((vector_size(32), aligned(8), may_alias));
using Two = double __attribute__((vector_size(16), aligned(8), may_alias));
struct Column {
  Four upper;
  Two lower;
};

[[gnu::target("avx"), gnu::always_inline]] inline Column loadColumn(const double* column) {
  return {*reinterpret_cast<const Four*>(column), *reinterpret_cast<const Two*>(column + 4)};
}

[[gnu::target("avx"), gnu::always_inline]] inline void storeColumn(const Column& column,
                                                                   double* to) {
  *reinterpret_cast<Four*>(to) = column.upper;
  *reinterpret_cast<Two*>(to + 4) = column.lower;
}

[[gnu::target("avx")]] void divideWithAvx(const Matrix6d& L, Matrix6d* B) {
  std::array<Column, 6> done;
#pragma GCC unroll 6
  for (int j = 0; j < 6; ++j) {
    Column column = loadColumn(B->data() + 6 * j);
#pragma GCC unroll 6
    for (int k = 0; k < j; ++k) {
      column.upper -= done[k].upper * L(j, k);
      column.lower -= done[k].lower * L(j, k);
    }
    done[j] = {column.upper * L(j, j), column.lower * L(j, j)};
    storeColumn(done[j], B->data() + 6 * j);
  }
}

// Three columns of C at a time, six registers of sums.
[[gnu::target("avx")]] void subtractWithAvx(const Matrix6d& A, const Matrix6d& B, Matrix6d* C) {
  for (int first = 0; first < 6; first += 3) {
    std::array<Column, 3> sums;
#pragma GCC unroll 3
    for (int j = 0; j < 3; ++j) sums[j] = loadColumn(C->data() + 6 * (first + j));
#pragma GCC unroll 6
    for (int k = 0; k < 6; ++k) {
      const Column a = loadColumn(A.data() + 6 * k);
#pragma GCC unroll 3
      for (int j = 0; j < 3; ++j) {
        sums[j].upper -= a.upper * B(first + j, k);
        sums[j].lower -= a.lower * B(first + j, k);
      }
    }
#pragma GCC unroll 3
    for (int j = 0; j < 3; ++j) storeColumn(sums[j], C->data() + 6 * (first + j));
  }
}

constexpr std::array kForms{kPortable, BlockKernels{"AVX", divideWithAvx, subtractWithAvx}};

std::size_t runnableForms() noexcept {
  __builtin_cpu_init();
  return __builtin_cpu_supports("avx") != 0 ? 2 : 1;
}

#else

constexpr std::array kForms{kPortable};
std::size_t runnableForms() noexcept { return 1; }

#endif

const BlockKernels kTaken = runnableBlockKernels().back();

}  // namespace

std::span<const BlockKernels> runnableBlockKernels() noexcept {
  return std::span(kForms).first(runnableForms());
}

void divideByTransposed(const Matrix6d& L, Matrix6d* B) { kTaken.divide_by_transposed(L, B); }

void subtractProduct(const Matrix6d& A, const Matrix6d& B, Matrix6d* C) {
  kTaken.subtract_product(A, B, C);
}

}  // namespace waymark::slam
