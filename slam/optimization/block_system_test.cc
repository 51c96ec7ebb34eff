#include "slam/optimization/block_system.h"

#include <limits>
#include <random>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr int kGlobals = BundleProblem::kGlobals;

Done arrange(BlockSystem* system, const std::vector<std::vector<int>>& neighbours,
             bool with_globals) {
  return runToCompletion([&](Budget* a) { return system->arrange(neighbours, with_globals, a); });
}

bool solve(BlockSystem* system) {
  return runToCompletion([&](Budget* a) { return system->solve(a); });
}

// A chain of poses, each tied to its neighbours and now and then to one far away, and the
// globals to all; the same as one dense matrix for Eigen.
struct Random {
  Random(int poses, bool with_globals) {
    std::vector<std::vector<int>> neighbours(static_cast<std::size_t>(poses));
    for (int i = 1; i < poses; ++i) {
      neighbours[static_cast<std::size_t>(i)].push_back(i - 1);
      if (i > 10 && i % 7 == 0) neighbours[static_cast<std::size_t>(i)].push_back(i / 3);
    }
    arrange(&system, neighbours, with_globals);
    const int size = 6 * poses + (with_globals ? kGlobals : 0);
    H.setZero(size, size);
    b.setZero(size);
    for (int i = 0; i < poses; ++i) {
      addBlock(i, i, Matrix6d(30.0 * Matrix6d::Identity() + symmetric<6>()));
      for (const int j : neighbours[static_cast<std::size_t>(i)]) {
        addBlock(i, j, Matrix6d::NullaryExpr([&] { return u(rng); }));
      }
      b.segment<6>(6 * i) = system.right(system.positionOf(i)) =
          Vector6d::NullaryExpr([&] { return u(rng); });
      if (!with_globals) continue;
      const PoseGlobalMatrix G = 0.1 * PoseGlobalMatrix::NullaryExpr([&] { return u(rng); });
      system.globalBlock(system.positionOf(i)) = G;
      H.block<6, kGlobals>(6 * i, size - kGlobals) = G;
      H.block<kGlobals, 6>(size - kGlobals, 6 * i) = G.transpose();
    }
    if (!with_globals) return;
    system.globals() = 50.0 * GlobalMatrix::Identity() + symmetric<kGlobals>();
    system.globalRight() = GlobalVector::NullaryExpr([&] { return u(rng); });
    H.bottomRightCorner<kGlobals, kGlobals>() = system.globals();
    b.tail<kGlobals>() = system.globalRight();
  }

  template <int N>
  Eigen::Matrix<double, N, N> symmetric() {
    const Eigen::Matrix<double, N, N> A =
        Eigen::Matrix<double, N, N>::NullaryExpr([&] { return u(rng); });
    return A + A.transpose();
  }

  void addBlock(int i, int j, const Matrix6d& block) {
    const int row = system.positionOf(i);
    const int column = system.positionOf(j);
    Matrix6d& own = system.block(system.place(std::max(row, column), std::min(row, column)));
    own = row >= column ? block : Matrix6d(block.transpose());
    H.block<6, 6>(6 * i, 6 * j) = block;
    H.block<6, 6>(6 * j, 6 * i) = block.transpose();
  }

  // After solve().
  [[nodiscard]] Eigen::VectorXd solution() {
    Eigen::VectorXd x(b.size());
    for (int i = 0; i < system.poses(); ++i) {
      x.segment<6>(6 * i) = system.right(system.positionOf(i));
    }
    if (x.size() > 6 * system.poses()) x.tail<kGlobals>() = system.globalRight();
    return x;
  }

  std::mt19937 rng{1};
  std::uniform_real_distribution<double> u{-1.0, 1.0};
  BlockSystem system;
  Eigen::MatrixXd H;
  Eigen::VectorXd b;
};

TEST(BlockSystem, SolvesWhatADenseSolverSolves) {
  for (const int poses : {1, 2, 12, 60, 151}) {
    for (const bool with_globals : {false, true}) {
      Random random(poses, with_globals);
      ASSERT_TRUE(solve(&random.system)) << poses;
      const Eigen::VectorXd expected = random.H.ldlt().solve(random.b);
      EXPECT_LT((random.solution() - expected).norm(), 1e-9 * expected.norm()) << poses << " poses";
    }
  }
}

// The factor that is there, and other right sides.
TEST(BlockSystem, SolvesAgainForOtherRightSides) {
  for (const int poses : {1, 2, 12, 60, 151}) {
    Random random(poses, false);
    ASSERT_TRUE(solve(&random.system)) << poses;
    random.b = Eigen::VectorXd::NullaryExpr(random.b.size(), [&] { return random.u(random.rng); });
    for (int i = 0; i < poses; ++i) {
      random.system.right(random.system.positionOf(i)) = random.b.segment<6>(6 * i);
    }
    ASSERT_TRUE(runToCompletion([&](Budget* a) { return random.system.solveAgain(a); })) << poses;
    const Eigen::VectorXd expected = random.H.ldlt().solve(random.b);
    EXPECT_LT((random.solution() - expected).norm(), 1e-9 * expected.norm()) << poses << " poses";
  }
}

// A hundred poses around one that all are tied to, as keyframes around a marker: eliminated last,
// it costs one block each; eliminated first, it would tie all to all.
TEST(BlockSystem, EliminatesInAnOrderThatFillsInLittle) {
  constexpr int kPoses = 100;
  std::vector<std::vector<int>> neighbours(kPoses + 1);
  for (int i = 1; i <= kPoses; ++i) neighbours[0].push_back(i);
  BlockSystem system;
  arrange(&system, neighbours, false);
  EXPECT_GE(system.positionOf(0), kPoses - 1);
  EXPECT_EQ(system.place(kPoses, kPoses), 2U * kPoses) << "the last of 101 + 100 places";
}

TEST(BlockSystem, TellsTheCovarianceOfTheGlobals) {
  Random random(12, true);
  ASSERT_TRUE(solve(&random.system));
  const Eigen::MatrixXd inverse = random.H.inverse();
  const auto covariance = random.system.globalsCovariance();
  ASSERT_TRUE(covariance);
  EXPECT_LT((*covariance - inverse.bottomRightCorner<kGlobals, kGlobals>()).norm(), 1e-11);
}

TEST(BlockSystem, InvertsWhereItsFactorHasBlocks) {
  for (const int poses : {1, 2, 12, 60}) {
    Random random(poses, false);
    ASSERT_TRUE(solve(&random.system));
    (void)runToCompletion([&](Budget* a) { return random.system.invert(a); });
    const Eigen::MatrixXd inverse = random.H.inverse();
    int known = 0;
    for (int i = 0; i < poses; ++i) {
      for (int j = 0; j < poses; ++j) {
        const int row = random.system.positionOf(i);
        const int column = random.system.positionOf(j);
        if (row < column) continue;
        const auto place = random.system.findPlace(row, column);
        if (!place) continue;
        ++known;
        const Matrix6d expected = inverse.block<6, 6>(6 * i, 6 * j);
        EXPECT_LT((random.system.block(*place) - expected).norm(), 1e-12) << i << ", " << j;
      }
    }
    EXPECT_GE(known, 2 * poses - 1) << "the diagonal, and the chain";
  }
}

// Cut into slices of any size, it is the same computation.
TEST(BlockSystem, SlicesChangeNothing) {
  Random whole(60, true);
  Random sliced(60, true);
  ASSERT_TRUE(solve(&whole.system));
  SlicedTask<bool> task([&](Budget* a) { return sliced.system.solve(a); });
  int slices = 1;
  while (!task.advance(1.0)) ++slices;
  EXPECT_GT(slices, 10);
  ASSERT_TRUE(task.take());
  EXPECT_EQ(whole.solution(), sliced.solution());
}

TEST(BlockSystem, HasNoAnswerToASystemThatIsNotPositiveDefinite) {
  for (const int poses : {2, 30}) {
    const std::vector<std::vector<int>> alone(static_cast<std::size_t>(poses));
    const auto filled = [&](double diagonal) {
      BlockSystem system;
      arrange(&system, alone, false);
      for (int i = 0; i < poses; ++i) system.diagonal(i) = diagonal * Matrix6d::Identity();
      return system;
    };
    BlockSystem zero = filled(0.0);
    EXPECT_FALSE(solve(&zero)) << "nothing is known of any pose";
    BlockSystem negative = filled(1.0);
    negative.diagonal(1) = -Matrix6d::Identity();
    EXPECT_FALSE(solve(&negative));
    BlockSystem infinite = filled(1.0);
    infinite.right(0).setConstant(std::numeric_limits<double>::infinity());
    EXPECT_FALSE(solve(&infinite));
  }
}

TEST(BlockSystem, NothingToSolveIsSolved) {
  BlockSystem empty;
  arrange(&empty, {}, false);
  EXPECT_TRUE(solve(&empty));
  BlockSystem lens_only;
  arrange(&lens_only, {}, true);
  lens_only.globals() = 2.0 * GlobalMatrix::Identity();
  lens_only.globalRight().setConstant(4.0);
  ASSERT_TRUE(solve(&lens_only));
  EXPECT_LT((lens_only.globalRight() - GlobalVector::Constant(2.0)).norm(), 1e-12);
}

}  // namespace
}  // namespace waymark::slam
