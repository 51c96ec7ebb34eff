#include "slam/optimisation/reduced_system.h"

#include <limits>
#include <random>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr int kGlobals = BundleProblem::kGlobals;

// A chain of poses, each tied to its neighbours and now and then to one far away, and the
// globals to all; the same as one dense matrix for Eigen.
struct Random {
  Random(int poses, bool with_globals) : system(poses, with_globals) {
    const int size = 6 * poses + (with_globals ? kGlobals : 0);
    H.setZero(size, size);
    b.setZero(size);
    for (int i = 0; i < poses; ++i) {
      addBlock(i, i, Matrix6d(30.0 * Matrix6d::Identity() + symmetric<6>()));
      if (i > 0) addBlock(i, i - 1, Matrix6d::NullaryExpr([&] { return u(rng); }));
      if (i > 10 && i % 7 == 0) addBlock(i, i / 3, Matrix6d::NullaryExpr([&] { return u(rng); }));
      const Vector6d right = Vector6d::NullaryExpr([&] { return u(rng); });
      system.addRight(i, right);
      b.segment<6>(6 * i) += right;
      if (with_globals) addGlobalBlock(i, 0.1 * PoseGlobalMatrix::Random());
    }
    if (!with_globals) return;
    const GlobalMatrix globals = 50.0 * GlobalMatrix::Identity() + symmetric<kGlobals>();
    const GlobalVector right = GlobalVector::NullaryExpr([&] { return u(rng); });
    system.addGlobals(globals, right);
    H.bottomRightCorner<kGlobals, kGlobals>() += globals;
    b.tail<kGlobals>() += right;
  }

  template <int N>
  Eigen::Matrix<double, N, N> symmetric() {
    const Eigen::Matrix<double, N, N> A =
        Eigen::Matrix<double, N, N>::NullaryExpr([&] { return u(rng); });
    return A + A.transpose();
  }

  void addBlock(int row, int column, const Matrix6d& block) {
    system.addBlock(row, column, block);
    H.block<6, 6>(6 * row, 6 * column) += block;
    if (row != column) H.block<6, 6>(6 * column, 6 * row) += block.transpose();
  }

  void addGlobalBlock(int row, const PoseGlobalMatrix& block) {
    system.addGlobalBlock(row, block);
    H.block<6, kGlobals>(6 * row, H.cols() - kGlobals) += block;
    H.block<kGlobals, 6>(H.rows() - kGlobals, 6 * row) += block.transpose();
  }

  std::mt19937 rng{1};
  std::uniform_real_distribution<double> u{-1.0, 1.0};
  ReducedSystem system;
  Eigen::MatrixXd H;
  Eigen::VectorXd b;
};

// Up to 150 poses (900 unknowns) are solved densely, more of them sparsely.
TEST(ReducedSystem, DenseAndSparseSolveTheSameSystem) {
  for (const int poses : {1, 12, 150, 151}) {
    for (const bool with_globals : {false, true}) {
      const Random random(poses, with_globals);
      const auto x = random.system.solve();
      ASSERT_TRUE(x) << poses;
      const Eigen::VectorXd expected = random.H.ldlt().solve(random.b);
      EXPECT_LT((*x - expected).norm(), 1e-9 * expected.norm()) << poses << " poses";
    }
  }
}

// Blocks come in any order and in pieces.
TEST(ReducedSystem, BlocksAddUp) {
  for (const int poses : {10, 160}) {
    ReducedSystem whole(poses, false);
    ReducedSystem pieces(poses, false);
    for (int i = 0; i < poses; ++i) {
      whole.addBlock(i, i, 4.0 * Matrix6d::Identity());
      whole.addRight(i, Vector6d::Constant(i));
      const int j = poses - 1 - i;
      pieces.addBlock(j, j, 3.0 * Matrix6d::Identity());
      pieces.addBlock(j, j, Matrix6d::Identity());
      pieces.addRight(j, Vector6d::Constant(j));
    }
    EXPECT_EQ(*whole.solve(), *pieces.solve());
  }
}

TEST(ReducedSystem, HasNoAnswerToASystemThatIsNotPositiveDefinite) {
  for (const int poses : {2, 160}) {
    ReducedSystem zero(poses, false);
    EXPECT_FALSE(zero.solve()) << "nothing is known of any pose";
    ReducedSystem negative(poses, false);
    for (int i = 0; i < poses; ++i) {
      negative.addBlock(i, i, (i == 1 ? -1.0 : 1.0) * Matrix6d::Identity());
    }
    EXPECT_FALSE(negative.solve());
    ReducedSystem infinite(poses, false);
    for (int i = 0; i < poses; ++i) infinite.addBlock(i, i, Matrix6d::Identity());
    infinite.addRight(0, Vector6d::Constant(std::numeric_limits<double>::infinity()));
    EXPECT_FALSE(infinite.solve());
  }
}

TEST(ReducedSystem, NothingToSolveIsSolved) {
  const ReducedSystem empty(0, false);
  ASSERT_TRUE(empty.solve());
  EXPECT_EQ(empty.solve()->size(), 0);
  ReducedSystem lens_only(0, true);
  lens_only.addGlobals(2.0 * GlobalMatrix::Identity(), GlobalVector::Constant(4.0));
  ASSERT_TRUE(lens_only.solve());
  EXPECT_LT((*lens_only.solve() - Eigen::VectorXd::Constant(kGlobals, 2.0)).norm(), 1e-12);
}

}  // namespace
}  // namespace waymark::slam
