#include "slam/pieces/joined_map.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

// A wall, of which the one map knows the left half, and the other one the right half in a world of
// its own; it has also seen some of the left.
class JoinedMapTest : public ::testing::Test {
 protected:
  JoinedMapTest() {
    std::vector<Transform> places;
    for (int i = 0; i < 6; ++i) {
      const double x = -0.5 + 0.2 * i;
      places.push_back(testing::lookAt({x, 0.4, 0.1 * x}, {0.3 * x, 3.0, 0.0}));
    }
    std::vector<testing::SyntheticMarker> left;
    std::vector<testing::SyntheticMarker> right;
    for (const auto& marker : testing::markerWall(2, 6, 0.4, &rng_)) {
      (marker.id % 6 < 3 ? left : right).push_back(marker);
    }
    into_ = testing::trueMap(camera_, places, left, kSide_m, kCorner_px, &rng_);
    into_.dictionary = "36h11";
    from_ = testing::trueMap(camera_, places, right, kSide_m, kCorner_px, &rng_);
    from_.piece = 3;
    for (const auto& [id, keyframe] : into_.keyframes()) {
      const MarkerDetection& seen = keyframe.detections.front();
      from_.addMarker(seen.id, kSide_m);
      from_.setElsewhere(seen.id, true);
      from_.addView(id, seen);
    }
    joint_.T_a_b = T_a_b_;
    joint_.covariance = 1e-4 * Matrix6d::Identity();
    from_.moveWorld(T_a_b_.inverse());
  }

  [[nodiscard]] JoinedMap atOnce() const {
    return runToCompletion([&](Budget* b) { return joinMaps(into_, from_, joint_, b); });
  }

  static constexpr double kSide_m = 0.12;
  static constexpr double kCorner_px = 0.1;
  std::mt19937 rng_{5};
  CameraModel camera_{testing::testCalibration()};
  Map into_;
  Map from_;
  Transform T_a_b_ = Transform{}.retract((Vector6d() << 4.0, -7.0, 1.0, 0.4, -0.3, 2.0).finished());
  PieceJoint joint_;
};

TEST_F(JoinedMapTest, HasAllOfBoth) {
  const JoinedMap joined = atOnce();
  const Map& map = joined.map;
  EXPECT_EQ(map.dictionary, into_.dictionary);
  EXPECT_EQ(map.piece, into_.piece);
  EXPECT_EQ(map.keyframes().size(), into_.keyframes().size() + from_.keyframes().size());
  EXPECT_EQ(map.viewCount(), into_.viewCount() + from_.viewCount());
  for (const auto& [id, keyframe] : into_.keyframes()) {
    EXPECT_EQ(map.keyframes().at(id).T_w_c.p, keyframe.T_w_c.p) << "the world stays";
  }
  EXPECT_EQ(joined.newest, map.keyframes().rbegin()->first);
  for (const auto& [id, theirs] : from_.markers()) {
    const MapMarker* const marker = map.findPosed(id);
    ASSERT_NE(marker, nullptr) << id;
    EXPECT_EQ(map.viewsOf(id).size(), into_.viewsOf(id).size() + from_.viewsOf(id).size()) << id;
    if (!theirs.T_w_m) {
      EXPECT_EQ(marker->T_w_m->p, into_.findPosed(id)->T_w_m->p) << "known already";
      continue;
    }
    EXPECT_LT((marker->T_w_m->p - (T_a_b_ * *theirs.T_w_m).p).norm(), 1e-12) << id;
    EXPECT_GE(marker->world_covariance(0, 0), 1e-4) << "what is not known of the joint";
  }
}

TEST_F(JoinedMapTest, GoesOnWithIdsAndEpoch) {
  into_.moveWorld(Transform{});
  const KeyframeId last = into_.keyframes().rbegin()->first;
  into_.removeKeyframe(last);
  const JoinedMap joined = atOnce();
  EXPECT_EQ(joined.map.epoch(), into_.epoch());
  EXPECT_FALSE(joined.map.keyframes().contains(last)) << "an id is never used again";
}

// In slices that are counted, and all the same however long they are.
TEST_F(JoinedMapTest, IsCutIntoSlices) {
  constexpr double kCost = 2.0;
  SlicedTask<JoinedMap> task([&](Budget* b) { return joinMaps(into_, from_, joint_, b); });
  int slices = 1;
  while (!task.advance(kCost)) {
    EXPECT_GT(task.left(), -2.0) << "no step is a large one";
    ++slices;
  }
  const double steps = static_cast<double>(into_.keyframes().size() + from_.keyframes().size() +
                                           into_.markers().size() + from_.markers().size());
  EXPECT_GE(slices, 0.3 * steps / kCost);
  const JoinedMap joined = task.take();
  const JoinedMap whole = atOnce();
  ASSERT_EQ(joined.map.keyframes().size(), whole.map.keyframes().size());
  for (const auto& [id, keyframe] : whole.map.keyframes()) {
    EXPECT_EQ(joined.map.keyframes().at(id).T_w_c.p, keyframe.T_w_c.p);
  }
}

}  // namespace
}  // namespace waymark::slam
