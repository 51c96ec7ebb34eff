#include "slam/optimization/block_kernels.h"

#include <gtest/gtest.h>

#include "slam/geometry/small_cholesky.h"

namespace waymark::slam {
namespace {

class BlockKernelsTest : public ::testing::Test {
 protected:
  BlockKernelsTest() { std::srand(1); }  // Eigen's Random
};

TEST_F(BlockKernelsTest, ThePortableFormIsAlwaysThere) {
  ASSERT_FALSE(runnableBlockKernels().empty());
  EXPECT_STREQ(runnableBlockKernels().front().name, "portable");
}

TEST_F(BlockKernelsTest, EveryFormSubtractsTheProduct) {
  for (const BlockKernels& form : runnableBlockKernels()) {
    for (int i = 0; i < 100; ++i) {
      const Matrix6d A = Matrix6d::Random();
      const Matrix6d B = Matrix6d::Random();
      const Matrix6d C = Matrix6d::Random();
      Matrix6d result = C;
      form.subtract_product(A, B, &result);
      Matrix6d portable = C;
      runnableBlockKernels().front().subtract_product(A, B, &portable);
      EXPECT_EQ(result, portable) << form.name;
      EXPECT_LT((result - (C - A * B.transpose())).lpNorm<Eigen::Infinity>(), 1e-14) << form.name;
    }
  }
}

TEST_F(BlockKernelsTest, EveryFormDividesByTheFactor) {
  for (const BlockKernels& form : runnableBlockKernels()) {
    for (int i = 0; i < 100; ++i) {
      const Matrix6d X = Matrix6d::Random();
      const Matrix6d H = X * X.transpose() + Matrix6d::Identity();
      Matrix6d factor = H;
      ASSERT_TRUE(factorizeCholesky(&factor));
      const Matrix6d B = Matrix6d::Random();
      Matrix6d result = B;
      form.divide_by_transposed(factor, &result);
      Matrix6d portable = B;
      runnableBlockKernels().front().divide_by_transposed(factor, &portable);
      EXPECT_EQ(result, portable) << form.name;
      Matrix6d L = factor.triangularView<Eigen::StrictlyLower>();
      L.diagonal() = factor.diagonal().cwiseInverse();
      EXPECT_LT((result * L.transpose() - B).lpNorm<Eigen::Infinity>(), 1e-13) << form.name;
    }
  }
}

// A block may be both factors, and a factor of itself is what the diagonal's update is.
TEST_F(BlockKernelsTest, OneBlockMayBeBothFactors) {
  for (const BlockKernels& form : runnableBlockKernels()) {
    const Matrix6d A = Matrix6d::Random();
    Matrix6d result = Matrix6d::Zero();
    form.subtract_product(A, A, &result);
    EXPECT_LT((result + A * A.transpose()).lpNorm<Eigen::Infinity>(), 1e-14) << form.name;
  }
}

TEST_F(BlockKernelsTest, TransportIsAProduct) {
  const Eigen::Vector3d d(0.3, -0.2, 0.9);
  Matrix6d K = Matrix6d::Identity();
  K.topRightCorner<3, 3>() << 0.0, d.z(), -d.y(), -d.z(), 0.0, d.x(), d.y(), -d.x(), 0.0;
  const Matrix6d X = Matrix6d::Random();
  EXPECT_LT((transposedTransport<6>(d, X) - K.transpose() * X).lpNorm<Eigen::Infinity>(), 1e-15);
}

}  // namespace
}  // namespace waymark::slam
