#include "slam/natural/filter/consensus.h"

#include <algorithm>
#include <numeric>
#include <random>
#include <vector>

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
  const std::vector<Refuter::Match> matches(40, {kExcess * Eigen::Matrix2d::Identity(), 0});
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
    refuter.refute(frame.r.data(), rows.data(), 80, matches, 9.21, &marked);
    EXPECT_FALSE(marked[10]) << seed;
    EXPECT_FALSE(marked[25]) << seed;
    for (int i = 0; i < 40; ++i) good += i != 10 && i != 25 && marked[static_cast<std::size_t>(i)];
  }
  EXPECT_GE(missed_by_one, 20);
  EXPECT_GE(good, 30 * 37);  // of 38, at 99 % each
}

// How far match i is from what others expect of it, computed anew.
double distanceFrom(const Frame& frame, const std::vector<int>& others, int i) {
  const auto n = 2 * static_cast<Eigen::Index>(others.size());
  Eigen::MatrixXd A(n, n), B(2, n);
  Eigen::VectorXd r(n);
  const auto number = [&others](Eigen::Index k) {
    return 2 * others[static_cast<std::size_t>(k / 2)] + static_cast<int>(k % 2);
  };
  for (Eigen::Index j = 0; j < n; ++j) {
    r[j] = frame.r[number(j)];
    for (int k = 0; k < 2; ++k) B(k, j) = frame.S(2 * i + k, number(j));
    for (Eigen::Index k = 0; k < n; ++k) A(k, j) = frame.S(number(k), number(j));
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(A);
  const Eigen::Vector2d e = frame.r.segment<2>(2 * i) - B * factor.solve(r);
  const Eigen::Matrix2d C = frame.S.block<2, 2>(2 * i, 2 * i) - B * factor.solve(B.transpose());
  return e.dot(C.inverse() * e);
}

// The worst first, until none is beyond the limit of what the rest expects of it.
std::vector<int> agreeing(const Frame& frame, std::vector<int> left, double limit) {
  while (left.size() > 1) {
    double farthest = limit;
    int worst = -1;
    for (const int i : left) {
      std::vector<int> others = left;
      std::erase(others, i);
      const double d = distanceFrom(frame, others, i);
      if (d > farthest) {
        farthest = d;
        worst = i;
      }
    }
    if (worst < 0) break;
    std::erase(left, worst);
  }
  return left;
}

std::vector<int> refuted(const Frame& frame, const std::vector<int>& ages, double limit) {
  const auto count = static_cast<int>(ages.size());
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = frame.S;
  std::vector<Refuter::Match> matches;
  for (const int age : ages) matches.push_back({Eigen::Matrix2d::Zero(), age});
  std::vector<char> marked(ages.size(), 1);
  Refuter refuter(count);
  refuter.refute(frame.r.data(), rows.data(), 2 * count, matches, limit, &marked);
  std::vector<int> kept;
  for (int i = 0; i < count; ++i) {
    if (marked[static_cast<std::size_t>(i)]) kept.push_back(i);
  }
  return kept;
}

TEST(Refuter, IsTheForecastOfTheRest) {
  constexpr double kLimit = 4.0;
  std::vector<int> all(12);
  std::iota(all.begin(), all.end(), 0);
  for (unsigned seed = 0; seed < 10; ++seed) {
    Frame frame(12, seed);
    frame.r[8] += 1.2;
    EXPECT_EQ(refuted(frame, std::vector<int>(12, 3), kLimit), agreeing(frame, all, kLimit))
        << seed;
  }
}

// The older half among itself, with those that are as old as its youngest; then the others.
TEST(Refuter, JudgesTheYoungByTheOld) {
  constexpr double kLimit = 4.0;
  const std::vector<int> ages = {5, 90, 5, 90, 40, 40, 2, 40, 90, 40, 7, 2};
  const std::vector<int> old = {1, 3, 4, 5, 7, 8, 9};
  const std::vector<int> young = {10, 0, 2, 6, 11};  // the oldest first
  int refused = 0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    Frame frame(12, seed);
    frame.r[10] += 1.2;  // of an old one
    frame.r[4] += 1.2;   // ... and of a young one
    std::vector<int> expected = agreeing(frame, old, kLimit);
    for (const int i : young) {
      if (distanceFrom(frame, expected, i) <= kLimit) {
        expected.push_back(i);
      } else {
        ++refused;
      }
    }
    std::ranges::sort(expected);
    EXPECT_EQ(refuted(frame, ages, kLimit), expected) << seed;
  }
  EXPECT_GE(refused, 10);
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
