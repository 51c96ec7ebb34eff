#include "slam/natural/filter/kalman_update.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/vectorized.h"

namespace waymark::slam {
namespace {

constexpr int kChunk = 16;  // rows that are worked on together

// Four numbers side by side; the compiler makes of it what the processor has.
using FourDoubles = double __attribute__((vector_size(32), aligned(8), may_alias));

int roundedUp(int count) { return (count + kChunk - 1) / kChunk * kChunk; }

// Sixteen rows w (by columns) become w L^-T for columns `first` to `last` (excluded), those before
// are done. L by rows.
WAYMARK_VECTORIZED void solveChunk(double* w, const double* L, const double* inverse, int stride,
                                   int first, int last) {
  for (int j = first; j < last; ++j) {
    double* const column = w + static_cast<std::ptrdiff_t>(j) * kChunk;
    const double* const row = L + static_cast<std::ptrdiff_t>(j) * stride;
    FourDoubles a0 = *reinterpret_cast<const FourDoubles*>(column);
    FourDoubles a1 = *reinterpret_cast<const FourDoubles*>(column + 4);
    FourDoubles a2 = *reinterpret_cast<const FourDoubles*>(column + 8);
    FourDoubles a3 = *reinterpret_cast<const FourDoubles*>(column + 12);
    const double* before = w;
    for (int k = 0; k < j; ++k, before += kChunk) {
      const double l = row[k];
      a0 -= *reinterpret_cast<const FourDoubles*>(before) * l;
      a1 -= *reinterpret_cast<const FourDoubles*>(before + 4) * l;
      a2 -= *reinterpret_cast<const FourDoubles*>(before + 8) * l;
      a3 -= *reinterpret_cast<const FourDoubles*>(before + 12) * l;
    }
    const double scale = inverse[j];
    *reinterpret_cast<FourDoubles*>(column) = a0 * scale;
    *reinterpret_cast<FourDoubles*>(column + 4) = a1 * scale;
    *reinterpret_cast<FourDoubles*>(column + 8) = a2 * scale;
    *reinterpret_cast<FourDoubles*>(column + 12) = a3 * scale;
  }
}

// P -= W_i W_j^T for sixteen rows and sixteen columns, in parts of eight by four.
WAYMARK_VECTORIZED void subtractTile(const double* wi, const double* wj, int m, double* P,
                                     std::ptrdiff_t stride) {
  for (int c = 0; c < kChunk; c += 4) {
    for (int r = 0; r < kChunk; r += 8) {
      double* const p0 = P + c * stride + r;
      double* const p1 = p0 + stride;
      double* const p2 = p1 + stride;
      double* const p3 = p2 + stride;
      FourDoubles a0 = *reinterpret_cast<const FourDoubles*>(p0);
      FourDoubles b0 = *reinterpret_cast<const FourDoubles*>(p0 + 4);
      FourDoubles a1 = *reinterpret_cast<const FourDoubles*>(p1);
      FourDoubles b1 = *reinterpret_cast<const FourDoubles*>(p1 + 4);
      FourDoubles a2 = *reinterpret_cast<const FourDoubles*>(p2);
      FourDoubles b2 = *reinterpret_cast<const FourDoubles*>(p2 + 4);
      FourDoubles a3 = *reinterpret_cast<const FourDoubles*>(p3);
      FourDoubles b3 = *reinterpret_cast<const FourDoubles*>(p3 + 4);
      const double* u = wi + r;
      const double* v = wj + c;
      for (int k = 0; k < m; ++k, u += kChunk, v += kChunk) {
        const FourDoubles x = *reinterpret_cast<const FourDoubles*>(u);
        const FourDoubles y = *reinterpret_cast<const FourDoubles*>(u + 4);
        a0 -= x * v[0];
        b0 -= y * v[0];
        a1 -= x * v[1];
        b1 -= y * v[1];
        a2 -= x * v[2];
        b2 -= y * v[2];
        a3 -= x * v[3];
        b3 -= y * v[3];
      }
      *reinterpret_cast<FourDoubles*>(p0) = a0;
      *reinterpret_cast<FourDoubles*>(p0 + 4) = b0;
      *reinterpret_cast<FourDoubles*>(p1) = a1;
      *reinterpret_cast<FourDoubles*>(p1 + 4) = b1;
      *reinterpret_cast<FourDoubles*>(p2) = a2;
      *reinterpret_cast<FourDoubles*>(p2 + 4) = b2;
      *reinterpret_cast<FourDoubles*>(p3) = a3;
      *reinterpret_cast<FourDoubles*>(p3 + 4) = b3;
    }
  }
}

// The tile below the diagonal, above it.
void mirrorTile(double* P, std::ptrdiff_t stride, int row, int column) {
  for (int c = 0; c < kChunk; ++c) {
    const double* const from = P + (column + c) * stride + row;
    double* const to = P + row * stride + column + c;
    for (int r = 0; r < kChunk; ++r) to[r * stride] = from[r];
  }
}

}  // namespace

KalmanUpdate::KalmanUpdate(int max_state, int max_rows)
    : state_stride_(roundedUp(max_state)), row_stride_(roundedUp(max_rows)) {
  const auto state = static_cast<std::size_t>(state_stride_);
  const auto rows = static_cast<std::size_t>(row_stride_);
  pht_.assign(state * rows, 0.0);
  s_.assign(rows * rows, 0.0);
  inverse_.assign(rows, 0.0);
  residual_.assign(rows, 0.0);
  chunks_.assign(state * rows, 0.0);
  chunk_.assign(static_cast<std::size_t>(kChunk) * rows, 0.0);
  delta_.assign(state, 0.0);
}

void KalmanUpdate::begin(int n, int m) {
  n_ = n;
  m_ = m;
}

void KalmanUpdate::keep(const int* rows, int count) {
  for (int i = 0; i < count; ++i) {
    const int from = rows[i];
    if (from != i) {
      std::memcpy(stateCovariance(i), stateCovariance(from),
                  sizeof(double) * static_cast<std::size_t>(n_));
    }
    residual(i) = residual(from);
    for (int k = 0; k <= i; ++k) innovationCovariance(i, k) = innovationCovariance(from, rows[k]);
  }
  m_ = count;
}

bool KalmanUpdate::factorize() {
  for (int top = 0; top < m_; top += kChunk) {
    const int rows = std::min(kChunk, m_ - top);
    double* const w = chunk_.data();
    for (int j = 0; j < top + rows; ++j) {
      for (int r = 0; r < kChunk; ++r) {
        w[j * kChunk + r] = r < rows && j <= top + r ? innovationCovariance(top + r, j) : 0.0;
      }
    }
    solveChunk(w, s_.data(), inverse_.data(), row_stride_, 0, top);
    for (int r = 0; r < rows; ++r) {
      for (int j = 0; j < top; ++j) innovationCovariance(top + r, j) = w[j * kChunk + r];
    }
    for (int j = top; j < top + rows; ++j) {
      const int own = j - top;
      for (int k = top; k < j; ++k) innovationCovariance(j, k) = w[k * kChunk + own];
      double* const column = w + static_cast<std::ptrdiff_t>(j) * kChunk;
      for (int k = 0; k < j; ++k) {
        const double l = innovationCovariance(j, k);
        for (int r = own; r < rows; ++r) column[r] -= l * w[k * kChunk + r];
      }
      const double pivot = column[own];
      if (!(pivot > 0.0) || !std::isfinite(pivot)) return false;
      inverse_[static_cast<std::size_t>(j)] = 1.0 / std::sqrt(pivot);
      for (int r = own; r < rows; ++r) column[r] *= inverse_[static_cast<std::size_t>(j)];
    }
  }
  return true;
}

bool KalmanUpdate::solve() {
  if (!factorize()) return false;
  chi2_ = 0.0;
  for (int j = 0; j < m_; ++j) {
    double sum = residual(j);
    for (int k = 0; k < j; ++k) sum -= innovationCovariance(j, k) * residual(k);
    residual(j) = sum * inverse_[static_cast<std::size_t>(j)];
    chi2_ += residual(j) * residual(j);
  }
  const std::ptrdiff_t per_chunk = static_cast<std::ptrdiff_t>(row_stride_) * kChunk;
  for (int top = 0; top < n_; top += kChunk) {
    double* const w = chunks_.data() + top / kChunk * per_chunk;
    const int rows = std::min(kChunk, n_ - top);
    for (int k = 0; k < m_; ++k) {
      const double* const from = stateCovariance(k) + top;
      for (int r = 0; r < rows; ++r) w[k * kChunk + r] = from[r];
      for (int r = rows; r < kChunk; ++r) w[k * kChunk + r] = 0.0;
    }
    solveChunk(w, s_.data(), inverse_.data(), row_stride_, 0, m_);
    double sums[kChunk] = {};
    for (int k = 0; k < m_; ++k) {
      for (int r = 0; r < kChunk; ++r) sums[r] += residual(k) * w[k * kChunk + r];
    }
    for (int r = 0; r < rows; ++r) delta_[static_cast<std::size_t>(top + r)] = sums[r];
  }
  return true;
}

void KalmanUpdate::reduce(double* P, int stride) const {
  const std::ptrdiff_t per_chunk = static_cast<std::ptrdiff_t>(row_stride_) * kChunk;
  for (int column = 0; column < n_; column += kChunk) {
    const double* const wj = chunks_.data() + column / kChunk * per_chunk;
    for (int row = column; row < n_; row += kChunk) {
      const double* const wi = chunks_.data() + row / kChunk * per_chunk;
      subtractTile(wi, wj, m_, P + static_cast<std::ptrdiff_t>(column) * stride + row, stride);
      if (row > column) mirrorTile(P, stride, row, column);
    }
  }
}

}  // namespace waymark::slam
