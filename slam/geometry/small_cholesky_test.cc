#include "slam/geometry/small_cholesky.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

using Matrix = Eigen::Matrix<double, 7, 7>;
using Vector = Eigen::Matrix<double, 7, 1>;

TEST(SmallCholesky, SolvesAsEigenDoes) {
  std::srand(1);  // Eigen's Random
  for (int trial = 0; trial < 20; ++trial) {
    const Matrix A = Matrix::Random();
    const Matrix H = A * A.transpose() + 0.1 * Matrix::Identity();
    const Vector b = Vector::Random();
    Matrix L = H;
    ASSERT_TRUE(factorizeCholesky(&L));
    EXPECT_LT((solveCholesky(L, b) - H.llt().solve(b)).norm(), 1e-9 * H.llt().solve(b).norm());
  }
}

TEST(SmallCholesky, RejectsWhatIsNotPositiveDefinite) {
  Matrix H = Matrix::Identity();
  H(3, 3) = -1.0;
  EXPECT_FALSE(factorizeCholesky(&H));
  H.setZero();
  EXPECT_FALSE(factorizeCholesky(&H));
}

}  // namespace
}  // namespace waymark::slam
