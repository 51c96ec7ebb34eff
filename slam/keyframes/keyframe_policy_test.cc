#include "slam/keyframes/keyframe_policy.h"

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

MarkerDetection seen(int id) {
  MarkerDetection d;
  d.id = id;
  return d;
}

// A line of keyframes 10 cm apart that all see marker 1.
Map lineOfKeyframes(int count) {
  Map map;
  map.markers[1] = {1, 0.1, Transform{}};
  for (int i = 0; i < count; ++i) {
    Keyframe keyframe;
    keyframe.index = map.next_keyframe_index++;
    keyframe.T_w_c.p = {0.1 * i, 0.0, 0.0};
    keyframe.detections = {seen(1)};
    map.keyframes.push_back(keyframe);
  }
  return map;
}

TEST(KeyframePolicy, FollowsTheRulesOfSection44) {
  const KeyframeOptions options;
  const Map map = lineOfKeyframes(1);
  Transform here;
  const std::vector<MarkerDetection> known = {seen(1)};
  const std::vector<MarkerDetection> with_new = {seen(1), seen(2)};
  EXPECT_EQ(keyframeReason(map, known, here, 2.0, false, options), KeyframeReason::kNone);
  EXPECT_EQ(keyframeReason(map, with_new, here, 2.0, false, options), KeyframeReason::kNewMarker);
  EXPECT_EQ(keyframeReason(map, known, here, 2.0, true, options), KeyframeReason::kMarkerResolved);
  here.p.x() = 0.079;  // 4 % of 2 m is 8 cm
  EXPECT_EQ(keyframeReason(map, known, here, 2.0, false, options), KeyframeReason::kNone);
  here.p.x() = 0.081;
  EXPECT_EQ(keyframeReason(map, known, here, 2.0, false, options), KeyframeReason::kBaseline);
}

TEST(KeyframePolicy, ReferenceIsTheNearest) {
  const Map map = lineOfKeyframes(5);
  Transform here;
  here.p = {0.31, 0.02, 0.0};
  EXPECT_EQ(referenceKeyframe(map, here, 1.0, {}), 3U);
}

TEST(KeyframePolicy, CullingKeepsTheMostDistantViewsAndTheFirst) {
  Map map = lineOfKeyframes(21);
  KeyframeOptions options;
  options.views_per_marker = 5;
  EXPECT_EQ(cullKeyframes(&map, options), 16);
  ASSERT_EQ(map.keyframes.size(), 5U);
  EXPECT_EQ(map.keyframes.front().index, 0);
  EXPECT_EQ(map.keyframes.back().index, 20);
  EXPECT_EQ(map.keyframes[2].index, 10);  // the middle one is the farthest from both ends
  // Nothing to do the second time.
  EXPECT_EQ(cullKeyframes(&map, options), 0);
}

TEST(KeyframePolicy, CullingLeavesAMarkerItsOnlyViews) {
  Map map = lineOfKeyframes(21);
  map.markers[2] = {2, 0.1, Transform{}};
  map.keyframes[7].detections.push_back(seen(2));
  KeyframeOptions options;
  options.views_per_marker = 3;
  (void)cullKeyframes(&map, options);
  const bool kept = std::any_of(map.keyframes.begin(), map.keyframes.end(),
                                [](const Keyframe& k) { return k.index == 7; });
  EXPECT_TRUE(kept);
}

}  // namespace
}  // namespace waymark::slam
