#include "slam/natural/filter/consensus.h"

#include <random>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

// Matches that share a large common error of four dimensions, as a camera's would be, and have
// 0.3 px of their own.
struct Frame {
  Frame(int count_, unsigned seed) : count(count_), S(2 * count_, 2 * count_), r(2 * count_) {
    std::mt19937 rng(seed);
    std::normal_distribution<double> n(0.0, 1.0);
    const Eigen::MatrixXd H = Eigen::MatrixXd::NullaryExpr(2 * count, 4, [&](int row, int column) {
      if (column < 2) return row % 2 == column ? 5.0 : 0.0;
      return 1.5 * n(rng);
    });
    S = H * H.transpose() + 0.09 * Eigen::MatrixXd::Identity(2 * count, 2 * count);
    const Eigen::Vector4d common(n(rng), n(rng), n(rng), n(rng));
    r = H * common;
    for (int i = 0; i < 2 * count; ++i) r[i] += 0.3 * n(rng);
  }
  [[nodiscard]] std::vector<char> consensus() const {
    const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = S;
    std::vector<char> marked(static_cast<std::size_t>(count));
    findConsensus(r.data(), rows.data(), 2 * count, count, 9.21, 20, &marked);
    return marked;
  }
  int count;
  Eigen::MatrixXd S;
  Eigen::VectorXd r;
};

TEST(Consensus, TakesThoseThatGoTogetherAndNoOthers) {
  for (unsigned seed = 0; seed < 30; ++seed) {
    Frame frame(40, seed);
    // A third are elsewhere, half of these all in the same way.
    for (int i = 0; i < 12; ++i) {
      frame.r[6 * i] += i % 2 == 0 ? 60.0 : 50.0 - 9.0 * i;
      frame.r[6 * i + 1] -= 45.0;
    }
    const auto marked = frame.consensus();
    int good = 0;
    for (int i = 0; i < 40; ++i) {
      if (i % 3 == 0 && i < 36) {
        EXPECT_FALSE(marked[static_cast<std::size_t>(i)]) << seed << " " << i;
      } else {
        good += marked[static_cast<std::size_t>(i)];
      }
    }
    EXPECT_GE(good, 22) << seed;  // of 28, at 99 % each
  }
}

// A window of a facade, found where the next one is: one other match cannot tell, all of them can.
TEST(Refuter, LeavesOutWhatAllTheOthersContradict) {
  constexpr double kExcess = 0.6 * 0.6;  // of noise that lasts, pixels^2
  const std::vector<Eigen::Matrix2d> excess(40, kExcess * Eigen::Matrix2d::Identity());
  int missed_by_one = 0;
  int good = 0;
  for (unsigned seed = 0; seed < 30; ++seed) {
    Frame frame(40, seed);
    frame.S.diagonal().array() += kExcess;
    frame.r[20] += 2.5;
    frame.r[21] += 1.0;
    frame.r[50] += 2.5;
    frame.r[51] += 1.0;
    auto marked = frame.consensus();
    missed_by_one += marked[10] + marked[25];
    const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = frame.S;
    Refuter refuter(50);
    refuter.refute(frame.r.data(), rows.data(), 80, excess, 9.21, &marked);
    EXPECT_FALSE(marked[10]) << seed;
    EXPECT_FALSE(marked[25]) << seed;
    for (int i = 0; i < 40; ++i) good += i != 10 && i != 25 && marked[static_cast<std::size_t>(i)];
  }
  EXPECT_GE(missed_by_one, 20);
  EXPECT_GE(good, 30 * 37);  // of 38, at 99 % each
}

// Each is judged by what the rest expects of it, computed anew.
TEST(Refuter, IsTheForecastOfTheRest) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    Frame frame(12, seed);
    frame.r[8] += 1.2;
    const auto distance = [&frame](const std::vector<int>& others, int i) {
      const auto n = 2 * static_cast<Eigen::Index>(others.size());
      Eigen::MatrixXd A(n, n), B(2, n);
      Eigen::VectorXd r(n);
      for (Eigen::Index j = 0; j < n; ++j) {
        const int from = 2 * others[static_cast<std::size_t>(j / 2)] + static_cast<int>(j % 2);
        r[j] = frame.r[from];
        for (int k = 0; k < 2; ++k) B(k, j) = frame.S(2 * i + k, from);
        for (Eigen::Index k = 0; k < n; ++k) {
          A(k, j) =
              frame.S(2 * others[static_cast<std::size_t>(k / 2)] + static_cast<int>(k % 2), from);
        }
      }
      const Eigen::LLT<Eigen::MatrixXd> factor(A);
      const Eigen::Vector2d e = frame.r.segment<2>(2 * i) - B * factor.solve(r);
      const Eigen::Matrix2d C = frame.S.block<2, 2>(2 * i, 2 * i) - B * factor.solve(B.transpose());
      return e.dot(C.inverse() * e);
    };
    // The worst first, until none is beyond the limit.
    constexpr double kLimit = 4.0;
    std::vector<int> left;
    for (int i = 0; i < 12; ++i) left.push_back(i);
    while (left.size() > 1) {
      double farthest = kLimit;
      int worst = -1;
      for (const int i : left) {
        std::vector<int> others = left;
        std::erase(others, i);
        const double d = distance(others, i);
        if (d > farthest) {
          farthest = d;
          worst = i;
        }
      }
      if (worst < 0) break;
      std::erase(left, worst);
    }
    std::vector<char> marked(12, 1);
    const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = frame.S;
    Refuter refuter(12);
    const std::vector<Eigen::Matrix2d> none(12, Eigen::Matrix2d::Zero());
    refuter.refute(frame.r.data(), rows.data(), 24, none, kLimit, &marked);
    std::vector<int> kept;
    for (int i = 0; i < 12; ++i) {
      if (marked[static_cast<std::size_t>(i)]) kept.push_back(i);
    }
    EXPECT_EQ(kept, left) << seed;
  }
}

TEST(Consensus, OneMatchIsJudgedByItself) {
  Frame near(1, 1);
  near.r << 1.0, -2.0;
  EXPECT_TRUE(near.consensus()[0]);
  near.r << 500.0, 0.0;
  EXPECT_FALSE(near.consensus()[0]);
}

TEST(Consensus, NoMatches) {
  std::vector<char> marked;
  findConsensus(nullptr, nullptr, 0, 0, 9.21, 20, &marked);
  EXPECT_TRUE(marked.empty());
}

}  // namespace
}  // namespace waymark::slam
