// The Kalman update of a large state by many measurements at once: dense, symmetric, in tiles that
// fit the registers. Takes its memory once.
#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

namespace waymark::slam {

class KalmanUpdate {
 public:
  // At most so many coordinates and measured numbers.
  KalmanUpdate(int max_state, int max_rows);

  // An update begins: n coordinates, m measured numbers.
  void begin(int n, int m);
  // To be filled in. Of measured number k: its covariance with the state (P H^T, n numbers), with
  // the numbers before it and itself (S, of which the lower triangle is looked at), and what was
  // measured minus what was expected.
  [[nodiscard]] double* stateCovariance(int k) {
    return pht_.data() + static_cast<std::ptrdiff_t>(k) * state_stride_;
  }
  [[nodiscard]] double& innovationCovariance(int row, int column) {
    return s_[static_cast<std::size_t>(row) * static_cast<std::size_t>(row_stride_) +
              static_cast<std::size_t>(column)];
  }
  [[nodiscard]] double& residual(int k) { return residual_[static_cast<std::size_t>(k)]; }
  // Between rows of the innovations' covariance.
  [[nodiscard]] int innovationStride() const { return row_stride_; }

  // Keeps only these measured numbers, in ascending order.
  void keep(const int* rows, int count);

  // S = L L^T, then chi2() and delta(). False when S is not positive definite.
  [[nodiscard]] bool solve();
  // r^T S^-1 r.
  [[nodiscard]] double chi2() const { return chi2_; }
  // P H^T S^-1 r, n numbers.
  [[nodiscard]] const double* delta() const { return delta_.data(); }
  // P -= P H^T S^-1 H P, after solve(). P: n x n, symmetric, its columns `stride` apart, a multiple
  // of 16, with finite numbers in what n lacks of one.
  void reduce(double* P, int stride) const;

 private:
  [[nodiscard]] bool factorize();

  int n_ = 0;
  int m_ = 0;
  int state_stride_ = 0;  // a multiple of 16
  int row_stride_ = 0;    // a multiple of 16
  double chi2_ = 0.0;
  std::vector<double> pht_;       // by columns
  std::vector<double> s_;         // by rows; then L
  std::vector<double> inverse_;   // of L's diagonal
  std::vector<double> residual_;  // then L^-1 r
  std::vector<double> chunks_;    // P H^T L^-T: sixteen rows after each other, by columns
  std::vector<double> chunk_;     // of S
  std::vector<double> delta_;
};

}  // namespace waymark::slam
