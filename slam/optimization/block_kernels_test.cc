#include "slam/optimization/block_kernels.h"

#include <gtest/gtest.h>

#include "slam/geometry/small_cholesky.h"

namespace waymark::slam {
namespace {

class BlockKernelsTest : public ::testing::Test {
 protected:
  BlockKernelsTest() { std::srand(1); }  // Eigen's Random
};

TEST_F(BlockKernelsTest, SubtractsTheProduct) {
  for (int i = 0; i < 100; ++i) {
    const Matrix6d A = Matrix6d::Random();
    const Matrix6d B = Matrix6d::Random();
    const Matrix6d C = Matrix6d::Random();
    Matrix6d result = C;
    subtractProduct(A, B, &result);
    EXPECT_LT((result - (C - A * B.transpose())).lpNorm<Eigen::Infinity>(), 1e-14);
#if defined(__x86_64__)  // where nothing is fused; every processor has the same bits
    Matrix6d by_columns = C;
    for (int k = 0; k < 6; ++k) by_columns -= A.col(k) * B.col(k).transpose();
    EXPECT_EQ(result, by_columns);
#endif
  }
}

TEST_F(BlockKernelsTest, DividesByTheFactor) {
  for (int i = 0; i < 100; ++i) {
    const Matrix6d X = Matrix6d::Random();
    const Matrix6d H = X * X.transpose() + Matrix6d::Identity();
    Matrix6d factor = H;
    ASSERT_TRUE(factorizeCholesky(&factor));
    const Matrix6d B = Matrix6d::Random();
    Matrix6d result = B;
    divideByTransposed(factor, &result);
    Matrix6d L = factor.triangularView<Eigen::StrictlyLower>();
    L.diagonal() = factor.diagonal().cwiseInverse();
    EXPECT_LT((result * L.transpose() - B).lpNorm<Eigen::Infinity>(), 1e-13);
  }
}

// A block may be both factors: the diagonal's update is that.
TEST_F(BlockKernelsTest, OneBlockMayBeBothFactors) {
  const Matrix6d A = Matrix6d::Random();
  Matrix6d result = Matrix6d::Zero();
  subtractProduct(A, A, &result);
  EXPECT_LT((result + A * A.transpose()).lpNorm<Eigen::Infinity>(), 1e-14);
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
