#include "slam/natural/filter/point_memory.h"

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

Matrix6d known(double sigma) { return sigma * sigma * Matrix6d::Identity(); }

TEST(PointMemory, KeepsPointsByTheCameraThatFirstSawThem) {
  PointMemory memory(2, 3);
  EXPECT_TRUE(memory.views().empty());
  memory.add(7, {}, known(0.01), {.rho = 0.5});
  memory.add(9, {}, known(0.02), {.rho = 0.25});
  memory.add(7, {}, known(0.05), {.rho = 1.0});
  ASSERT_EQ(memory.views().size(), 2U);
  EXPECT_EQ(memory.views()[0].points.size(), 2U);
  EXPECT_EQ(memory.views()[0].covariance, known(0.01)) << "as it was when the first was left";
  for (int i = 0; i < 5; ++i) memory.add(7, {}, known(0.01), {});
  EXPECT_EQ(memory.views()[0].points.size(), 3U);
  memory.forget(0);
  ASSERT_EQ(memory.views().size(), 1U);
  EXPECT_EQ(memory.views()[0].anchor, 9U);
  memory.clear();
  EXPECT_TRUE(memory.views().empty());
}

TEST(PointMemory, WhatIsKnownBestStays) {
  PointMemory memory(2, 3);
  memory.add(1, {}, known(0.01), {});
  memory.add(2, {}, known(0.03), {});
  memory.add(3, {}, known(0.04), {});
  EXPECT_EQ(memory.views()[1].anchor, 2U);
  memory.add(4, {}, known(0.02), {});
  EXPECT_EQ(memory.views()[1].anchor, 4U);
  EXPECT_FALSE(memory.views()[1].recalled);
  PointMemory none(0, 3);
  none.add(1, {}, known(0.01), {});
  EXPECT_TRUE(none.views().empty());
}

TEST(PointMemory, MovesWithTheWorld) {
  PointMemory memory(1, 1);
  Matrix6d covariance = known(0.01);
  covariance(0, 0) = 1.0;
  Transform T_w_a;
  T_w_a.p = {1.0, 0.0, 0.0};
  memory.add(1, T_w_a, covariance, {});
  Transform turn;
  turn.R = Eigen::AngleAxisd(0.5 * 3.14159265358979, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  turn.p = {0.0, 0.0, 2.0};
  memory.moveWorld(turn);
  EXPECT_LT((memory.views()[0].T_w_a.p - Eigen::Vector3d(0.0, 1.0, 2.0)).norm(), 1e-12);
  EXPECT_NEAR(memory.views()[0].covariance(1, 1), 1.0, 1e-9);
}

}  // namespace
}  // namespace waymark::slam
