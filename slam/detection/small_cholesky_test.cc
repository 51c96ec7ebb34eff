#include "slam/detection/small_cholesky.h"

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

using Matrix = SmallCholesky<7>::Matrix;
using Vector = SmallCholesky<7>::Vector;

TEST(SmallCholesky, SolvesAsEigenDoes) {
  std::srand(1);  // Eigen's Random
  for (int trial = 0; trial < 20; ++trial) {
    const Matrix A = Matrix::Random();
    const Matrix H = A * A.transpose() + 0.1 * Matrix::Identity();
    const Vector b = Vector::Random();
    SmallCholesky<7> factors;
    ASSERT_TRUE(factors.factorise(H));
    EXPECT_LT((factors.solve(b) - H.llt().solve(b)).norm(), 1e-9 * H.llt().solve(b).norm());
  }
}

TEST(SmallCholesky, RefusesWhatIsNotPositiveDefinite) {
  Matrix H = Matrix::Identity();
  SmallCholesky<7> factors;
  H(3, 3) = -1.0;
  EXPECT_FALSE(factors.factorise(H));
  H.setZero();
  EXPECT_FALSE(factors.factorise(H));
}

}  // namespace
}  // namespace waymark::slam
