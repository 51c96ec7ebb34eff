#include "slam/loop_closure/loop_region.h"

#include <algorithm>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

MarkerDetection seen(int id) {
  MarkerDetection detection;
  detection.id = id;
  return detection;
}

using Keyframes = std::vector<KeyframeId>;

// Two lanes, to and fro: keyframe k of the first one sees markers k and k + 1, and, where the lanes
// are near each other, keyframe 2 n - 1 - k of the second one the same two.
class LoopRegionTest : public ::testing::Test {
 protected:
  static constexpr int kLength = 50;  // keyframes of a lane

  // The lanes are apart where neither end of the way back nor its middle is.
  void makeLanes(int apart_from, int apart_to) {
    for (int k = 0; k < 2 * kLength; ++k) {
      const bool back = k >= kLength;
      const int place = back ? 2 * kLength - 1 - k : k;
      const bool apart = back && place >= apart_from && place < apart_to;
      const int first = apart ? 1000 + place : place;
      Keyframe keyframe;
      for (const int id : {first, first + 1}) {
        map_.addMarker(id, 0.2);
        map_.place(id, Transform{});
        keyframe.detections.push_back(seen(id));
      }
      (void)map_.addKeyframe(std::move(keyframe));
    }
  }

  [[nodiscard]] std::optional<LoopRegion> region(KeyframeId reference, int marker,
                                                 std::size_t max_views) const {
    const int markers[] = {marker};
    return runToCompletion(
        [&](Budget* b) { return loopRegion(map_, reference, markers, max_views, b); });
  }
  static Keyframes of(const SubproblemMembers& members) {
    Keyframes ids;
    for (const auto& role : members.keyframes) ids.push_back(role.keyframe);
    return ids;
  }

  Map map_;
};

TEST_F(LoopRegionTest, LiesAroundBothEnds) {
  makeLanes(0, 0);  // side by side all the way
  const auto found = region(2 * kLength - 1 - 20, 24, 40);
  ASSERT_TRUE(found);
  const std::vector<int>& markers = found->part.markers;
  const Keyframes moved = of(found->part);
  EXPECT_GE(moved.size(), 20U);  // of two views each
  EXPECT_LE(moved.size(), 21U);
  for (const auto& role : found->part.keyframes) EXPECT_FALSE(role.held);
  for (const KeyframeId id : moved) {
    const int place = static_cast<int>(id < kLength ? id : 2 * kLength - 1 - id);
    EXPECT_GE(place, 12) << id;
    EXPECT_LE(place, 32) << id;
  }
  EXPECT_TRUE(std::ranges::is_sorted(markers));
  // The rest holds its border: all who see one of its markers.
  Keyframes rest;
  for (const auto& [id, keyframe] : map_.keyframes()) {
    const bool sees_some = std::ranges::any_of(keyframe.detections, [&](const auto& d) {
      return std::ranges::binary_search(markers, d.id);
    });
    if (sees_some && !std::ranges::binary_search(moved, id)) rest.push_back(id);
    if (std::ranges::binary_search(moved, id)) {
      for (const auto& d : keyframe.detections) {
        EXPECT_TRUE(std::ranges::binary_search(markers, d.id));
      }
    }
  }
  EXPECT_FALSE(rest.empty());
  EXPECT_EQ(of(found->rest), rest);
  EXPECT_EQ(found->rest.markers, markers);
  for (const auto& role : found->rest.keyframes) EXPECT_TRUE(role.held);
}

// Round a long loop nothing less than the whole of it can be moved.
TEST_F(LoopRegionTest, ThereIsNoneWhereTheEndsAreFarApart) {
  makeLanes(0, kLength - 1);
  EXPECT_FALSE(region(2 * kLength - 1, 0, 40));
}

TEST_F(LoopRegionTest, ThereIsNoneOfASmallMap) {
  makeLanes(0, 0);
  EXPECT_FALSE(region(80, 24, 4 * kLength + 1));
  EXPECT_TRUE(region(80, 24, 4 * kLength - 20));
}

TEST_F(LoopRegionTest, NobodyKnowsTheEnds) {
  makeLanes(0, 0);
  EXPECT_FALSE(region(12345, 24, 40)) << "no such keyframe";
  EXPECT_FALSE(region(80, 12345, 40)) << "no such marker";
}

TEST_F(LoopRegionTest, TheMapGoesOnMeanwhile) {
  makeLanes(0, 0);
  const int markers[] = {24};
  SlicedTask<std::optional<LoopRegion>> task(
      [&](Budget* b) { return loopRegion(map_, 79, markers, 80, b); });
  int slices = 0;
  KeyframeId next = 70;
  while (!task.advance(0.5)) {
    ++slices;
    if (next < 95 && slices % 2 == 0) map_.removeKeyframe(next++);
  }
  EXPECT_GT(slices, 20);
  const auto found = task.take();
  ASSERT_TRUE(found);
  for (const auto& role : found->part.keyframes)
    EXPECT_TRUE(map_.keyframes().contains(role.keyframe));
}

}  // namespace
}  // namespace waymark::slam
