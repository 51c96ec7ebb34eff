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
