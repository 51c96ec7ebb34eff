#include "slam/geometry/align_points.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

Transform someMotion() {
  Vector6d delta;
  delta << 1.0, -2.0, 0.5, 0.4, -0.9, 1.3;
  return Transform{}.retract(delta);
}

TEST(AlignPoints, UndoesAnyRigidMotion) {
  std::mt19937 rng(3);
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (int i = 0; i < 10; ++i) {
    from.emplace_back(normal(rng), normal(rng), normal(rng));
    to.push_back(someMotion() * from.back());
  }
  const Transform T = alignPoints(from, to);
  EXPECT_LT((T.p - someMotion().p).norm(), 1e-12);
  EXPECT_LT((T.R - someMotion().R).norm(), 1e-12);
}

TEST(AlignPoints, OfALineOrAPointIsStillRigid) {
  for (const std::size_t count : {1, 2, 5}) {
    std::vector<Eigen::Vector3d> from;
    std::vector<Eigen::Vector3d> to;
    for (std::size_t i = 0; i < count; ++i) {
      from.emplace_back(0.1 * static_cast<double>(i), 0.0, 1.0);
      to.push_back(someMotion() * from.back());
    }
    const Transform T = alignPoints(from, to);
    EXPECT_NEAR(T.R.determinant(), 1.0, 1e-9);
    for (std::size_t i = 0; i < count; ++i) EXPECT_LT((T * from[i] - to[i]).norm(), 1e-9);
  }
}

}  // namespace
}  // namespace waymark::slam
