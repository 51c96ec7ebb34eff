#include "slam/map/world_reference.h"

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

class WorldReferenceTest : public ::testing::Test {
 protected:
  void place(int id) {
    map_.addMarker(id, 0.1);
    map_.place(id, Transform{});
  }

  MarkerOptions options_;
  Map map_;
  WorldReference world_{options_};
};

TEST_F(WorldReferenceTest, TheFirstKeyframeIsNeverMissing) { EXPECT_FALSE(world_.isMissing(map_)); }

TEST_F(WorldReferenceTest, AnOriginIsMissingUntilItHasAPose) {
  options_.origin_marker = 3;
  EXPECT_TRUE(world_.isMissing(map_));
  map_.addMarker(3, 0.1);
  EXPECT_TRUE(world_.isMissing(map_)) << "seen, but without a pose";
  place(4);
  EXPECT_TRUE(world_.isMissing(map_)) << "another marker";
  place(3);
  EXPECT_FALSE(world_.isMissing(map_));
}

TEST_F(WorldReferenceTest, OneAnchorIsEnough) {
  options_.anchors = {{.id = 5, .T_w_m = {}}, {.id = 6, .T_w_m = {}}};
  EXPECT_TRUE(world_.isMissing(map_));
  place(6);
  EXPECT_FALSE(world_.isMissing(map_));
}

// Where they hang in the map, a turn and a shift from where they were surveyed.
TEST_F(WorldReferenceTest, ThreePositionsThatAreNotInALineAreEnough) {
  Vector6d anyhow;
  anyhow << 1.0, -2.0, 3.0, 0.3, 0.2, -0.5;
  const Transform T_s_w = Transform{}.retract(anyhow);
  const auto survey = [&](int id, const Eigen::Vector3d& p_w) {
    options_.constraints.positions.push_back({.id = id, .p_w = T_s_w * p_w});
    place(id);
    map_.place(id, {Eigen::Matrix3d::Identity(), p_w});
  };
  survey(1, {0.0, 0.0, 0.0});
  survey(2, {4.0, 0.0, 0.0});
  EXPECT_TRUE(world_.isMissing(map_)) << "two";
  survey(3, {8.0, 0.01, 0.0});
  EXPECT_TRUE(world_.isMissing(map_)) << "a line";
  EXPECT_TRUE(firstKeyframeIsWorld(map_, options_));
  EXPECT_FALSE(isInSurvey(map_, options_));
  survey(4, {3.0, 2.0, 1.0});
  EXPECT_FALSE(firstKeyframeIsWorld(map_, options_));
  EXPECT_FALSE(world_.isMissing(map_));
  const Transform found = surveyedFromMap(map_, options_);
  EXPECT_LT((found.p - T_s_w.p).norm(), 1e-9);
  EXPECT_LT(rotationDistance(found.R, T_s_w.R), 1e-9);
  const Vector6d sigmas = surveyCovariance(map_, options_).diagonal().cwiseSqrt();
  EXPECT_LT(sigmas.head<3>().maxCoeff(), 0.002);
  EXPECT_GT(sigmas.tail<3>().minCoeff(), 1e-4);
}

TEST_F(WorldReferenceTest, OnceFoundItIsThere) {
  options_.origin_marker = 3;
  place(3);
  EXPECT_FALSE(world_.isMissing(map_));
  EXPECT_FALSE(world_.isMissing(Map{})) << "the marker was quarantined since";
}

}  // namespace
}  // namespace waymark::slam
