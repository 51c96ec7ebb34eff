#include "slam/natural/filter/surface.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

std::vector<SurfacePoint> plane(const Eigen::Vector2d& gradient, int count, double relief,
                                unsigned seed) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> u(-0.2, 0.2);
  std::normal_distribution<double> n(0.0, 0.01);
  std::vector<SurfacePoint> points;
  for (int i = 0; i < count; ++i) {
    SurfacePoint p;
    p.offset = {u(rng), u(rng)};
    p.relative = gradient.dot(p.offset) + n(rng) + relief * u(rng) / 0.2;
    p.sigma = 0.01;
    points.push_back(p);
  }
  return points;
}

TEST(Surface, OfAPlane) {
  const Eigen::Vector2d truth(1.0, -0.4);
  for (unsigned seed = 0; seed < 20; ++seed) {
    const auto gradient = surfaceGradient(plane(truth, 20, 0.0, seed));
    ASSERT_TRUE(gradient);
    EXPECT_LT((*gradient - truth).norm(), 0.15);
  }
}

TEST(Surface, WhatIsNoPlaneHasNone) {
  EXPECT_FALSE(surfaceGradient(plane({0.5, 0.5}, 20, 0.4, 1)));
}

TEST(Surface, TooFewOrInARowSayNothing) {
  EXPECT_FALSE(surfaceGradient(plane({0.5, 0.5}, 4, 0.0, 1)));
  EXPECT_FALSE(surfaceGradient({}));
  auto row = plane({0.5, 0.5}, 20, 0.0, 1);
  for (SurfacePoint& p : row) p.offset.y() = 0.0;
  EXPECT_FALSE(surfaceGradient(row));
}

}  // namespace
}  // namespace waymark::slam
