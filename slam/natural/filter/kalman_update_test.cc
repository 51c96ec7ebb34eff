#include "slam/natural/filter/kalman_update.h"

#include <random>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

Eigen::MatrixXd noiseMatrix(int rows, int columns, std::mt19937* rng) {
  std::normal_distribution<double> n(0.0, 1.0);
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return n(*rng); });
}

struct Problem {
  Problem(int n_, int m_, unsigned seed) : n(n_), m(m_), stride((n_ + 15) / 16 * 16) {
    std::mt19937 rng(seed);
    const Eigen::MatrixXd A = noiseMatrix(n, n + 3, &rng);
    P = A * A.transpose() / n;
    P = Eigen::MatrixXd(P.selfadjointView<Eigen::Lower>());
    H = noiseMatrix(m, n, &rng);
    S = H * P * H.transpose() + 0.3 * Eigen::MatrixXd::Identity(m, m);
    r = noiseMatrix(m, 1, &rng);
    padded = Eigen::MatrixXd::Constant(stride, stride, 7.0);
    padded.topLeftCorner(n, n) = P;
  }

  void fill(KalmanUpdate* update) const {
    update->begin(n, m);
    const Eigen::MatrixXd PHt = P * H.transpose();
    for (int k = 0; k < m; ++k) {
      for (int i = 0; i < n; ++i) update->stateCovariance(k)[i] = PHt(i, k);
      for (int j = 0; j <= k; ++j) update->innovationCovariance(k, j) = S(k, j);
      update->residual(k) = r[k];
    }
  }

  int n, m, stride;
  Eigen::MatrixXd P, H, S, padded;
  Eigen::VectorXd r;
};

class Sizes : public ::testing::TestWithParam<std::pair<int, int>> {};

TEST_P(Sizes, AreAsTheTextbookHasIt) {
  const auto [n, m] = GetParam();
  Problem problem(n, m, 3);
  KalmanUpdate update(300, 130);
  problem.fill(&update);
  ASSERT_TRUE(update.solve());
  update.reduce(problem.padded.data(), problem.stride);
  const Eigen::LLT<Eigen::MatrixXd> S(problem.S);
  const Eigen::MatrixXd PHt = problem.P * problem.H.transpose();
  const Eigen::VectorXd delta = PHt * S.solve(problem.r);
  const Eigen::MatrixXd P = problem.P - PHt * S.solve(PHt.transpose());
  const Eigen::Map<const Eigen::VectorXd> ours(update.delta(), n);
  EXPECT_LT((ours - delta).norm(), 1e-9 * (1.0 + delta.norm()));
  EXPECT_LT((problem.padded.topLeftCorner(n, n) - P).norm(), 1e-9 * problem.P.norm());
  EXPECT_NEAR(update.chi2(), problem.r.dot(S.solve(problem.r)), 1e-8 * update.chi2());
  // Symmetric to the last bit.
  EXPECT_EQ((problem.padded - problem.padded.transpose()).topLeftCorner(n, n).norm(), 0.0);
}

INSTANTIATE_TEST_SUITE_P(All, Sizes,
                         ::testing::Values(std::pair{12, 2}, std::pair{16, 16}, std::pair{33, 8},
                                           std::pair{96, 31}, std::pair{250, 120}));

TEST(KalmanUpdate, KeepsSomeOfTheRows) {
  Problem all(40, 20, 5);
  const std::vector<int> rows = {0, 1, 6, 7, 12, 13, 18, 19};
  KalmanUpdate update(40, 20);
  all.fill(&update);
  update.keep(rows.data(), static_cast<int>(rows.size()));
  Eigen::MatrixXd H(8, 40);
  Eigen::VectorXd r(8);
  Eigen::MatrixXd S(8, 8);
  for (int i = 0; i < 8; ++i) {
    H.row(i) = all.H.row(rows[static_cast<std::size_t>(i)]);
    r[i] = all.r[rows[static_cast<std::size_t>(i)]];
    for (int j = 0; j < 8; ++j) {
      S(i, j) = all.S(rows[static_cast<std::size_t>(i)], rows[static_cast<std::size_t>(j)]);
    }
  }
  ASSERT_TRUE(update.solve());
  const Eigen::VectorXd delta = all.P * H.transpose() * S.llt().solve(r);
  EXPECT_LT((Eigen::Map<const Eigen::VectorXd>(update.delta(), 40) - delta).norm(), 1e-9);
}

TEST(KalmanUpdate, WhatIsNotPositiveDefiniteIsRefused) {
  Problem problem(20, 4, 6);
  problem.S(2, 2) = -1.0;
  KalmanUpdate update(20, 4);
  problem.fill(&update);
  EXPECT_FALSE(update.solve());
}

}  // namespace
}  // namespace waymark::slam
