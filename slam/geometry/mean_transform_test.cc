#include "slam/geometry/mean_transform.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

TEST(MeanRotation, IsTheChordalMean) {
  std::mt19937 rng(62);
  std::vector<Eigen::Matrix3d> rotations;
  const Eigen::Matrix3d middle = expSo3({3.0, 0.3, -0.4});  // where quaternions change their sign
  for (int i = 0; i < 7; ++i) {
    rotations.push_back(testing::disturbed({middle, {}}, 0.2, &rng).R);
  }
  const auto cost = [&](const Eigen::Matrix3d& R) {
    double sum = 0.0;
    for (const auto& other : rotations) sum += (R - other).squaredNorm();
    return sum;
  };
  const Eigen::Matrix3d mean = meanRotation(rotations);
  EXPECT_NEAR(mean.determinant(), 1.0, 1e-12);
  for (int i = 0; i < 100; ++i) {
    EXPECT_LT(cost(mean), cost(testing::disturbed({mean, {}}, 0.01, &rng).R));
  }
  const Eigen::Matrix3d pair[] = {middle * expSo3({0.1, 0.0, 0.2}),
                                  middle * expSo3({-0.1, 0, -0.2})};
  EXPECT_LT(rotationDistance(meanRotation(pair), middle), 1e-7);
  EXPECT_LT(rotationDistance(meanRotation({pair, 1}), pair[0]), 1e-7);
}

}  // namespace
}  // namespace waymark::slam
