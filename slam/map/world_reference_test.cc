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

TEST_F(WorldReferenceTest, OnceFoundItIsThere) {
  options_.origin_marker = 3;
  place(3);
  EXPECT_FALSE(world_.isMissing(map_));
  EXPECT_FALSE(world_.isMissing(Map{})) << "the marker was quarantined since";
}

}  // namespace
}  // namespace waymark::slam
