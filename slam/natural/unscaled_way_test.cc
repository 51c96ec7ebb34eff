#include "slam/natural/unscaled_way.h"

#include <limits>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

// A metre along x, then one along y.
void walk(UnscaledWay* way, double first_sigma, double second_sigma) {
  way->goOn({2.0, 0.0, 0.0}, first_sigma);
  for (int i = 1; i <= 10; ++i) way->goOn({2.0 + 0.1 * i, 0.0, 0.0}, first_sigma);
  for (int i = 1; i <= 10; ++i) way->goOn({3.0, 0.1 * i, 0.0}, second_sigma);
}

TEST(UnscaledWay, AScaleThatIsKnownAddsNothing) {
  const UnscaledWayOptions options;
  UnscaledWay way(options);
  walk(&way, 0.016, options.from_scale_sigma);
  EXPECT_EQ(way.covariance().norm(), 0.0);
}

// Of the metre with a scale known to 10 % the covariance has told 0.1 m; the error may be 2.5 times
// as large.
TEST(UnscaledWay, WhatWasGoneInDoubtIsTold) {
  const UnscaledWayOptions options;
  UnscaledWay way(options);
  walk(&way, 0.01, 0.1);
  Eigen::Matrix3d expected = Eigen::Matrix3d::Zero();
  expected(1, 1) = (2.5 * 2.5 - 1.0) * 0.1 * 0.1;
  EXPECT_LT((way.covariance() - expected).norm(), 1e-12);
  // There and back: the same scale, and no way.
  for (int i = 9; i >= 0; --i) way.goOn({3.0, 0.1 * i, 0.0}, 0.1);
  EXPECT_LT(way.covariance().norm(), 1e-12);
}

TEST(UnscaledWay, IsForgottenWhereThePlaceIsKnown) {
  const UnscaledWayOptions options;
  UnscaledWay way(options);
  walk(&way, 0.1, 0.1);
  EXPECT_GT(way.covariance().norm(), 0.01);
  way.forget();
  EXPECT_EQ(way.covariance().norm(), 0.0);
  way.goOn({-5.0, 0.0, 0.0}, 0.1);  // not a way from where it was before
  EXPECT_EQ(way.covariance().norm(), 0.0);
}

TEST(UnscaledWay, TurnsWithTheWorld) {
  const UnscaledWayOptions options;
  UnscaledWay way(options), moved(options);
  walk(&way, 0.01, 0.1);
  walk(&moved, 0.01, 0.1);
  const Transform T_new_old{expSo3({0.4, -0.3, 1.0}), {5.0, 1.0, -2.0}};
  moved.moveWorld(T_new_old);
  way.goOn({3.0, 1.5, 0.0}, 0.1);
  moved.goOn(T_new_old * Eigen::Vector3d(3.0, 1.5, 0.0), 0.1);
  const Eigen::Matrix3d turned = T_new_old.R * way.covariance() * T_new_old.R.transpose();
  EXPECT_LT((moved.covariance() - turned).norm(), 1e-12);
}

TEST(UnscaledWayOptions, WhatCannotWorkIsTold) {
  EXPECT_EQ(UnscaledWayOptions{}.invalidReason(), "");
  EXPECT_NE((UnscaledWayOptions{.from_scale_sigma = 0.0}.invalidReason()), "");
  EXPECT_NE((UnscaledWayOptions{.ratio = 0.9}.invalidReason()), "");
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE((UnscaledWayOptions{.ratio = nan}.invalidReason()), "");
}

}  // namespace
}  // namespace waymark::slam
