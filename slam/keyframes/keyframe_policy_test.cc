#include "slam/keyframes/keyframe_policy.h"

#include <gtest/gtest.h>

#include "slam/testing/seen_marker.h"

namespace waymark::slam {
namespace {

using testing::lineOfKeyframes;
using testing::seen;

TEST(KeyframePolicy, FollowsTheRulesOfSection44) {
  const KeyframeOptions options;
  const Map map = lineOfKeyframes(1);
  Transform here;
  const std::vector<MarkerDetection> known = {seen(1)};
  const std::vector<MarkerDetection> with_new = {seen(1), seen(3)};
  EXPECT_EQ(keyframeReason(map, known, here, 2.0, false, options), KeyframeReason::kNone);
  EXPECT_EQ(keyframeReason(map, with_new, here, 2.0, false, options), KeyframeReason::kNewMarker);
  EXPECT_EQ(keyframeReason(map, known, here, 2.0, true, options), KeyframeReason::kMarkerResolved);
  here.p.x() = 0.079;  // 4 % of 2 m is 8 cm
  EXPECT_EQ(keyframeReason(map, known, here, 2.0, false, options), KeyframeReason::kNone);
  here.p.x() = 0.081;
  EXPECT_EQ(keyframeReason(map, known, here, 2.0, false, options), KeyframeReason::kBaseline);
}

// A frame that culling would let go at once is none.
TEST(KeyframePolicy, TakesNoFrameThatCullingWouldNotKeep) {
  KeyframeOptions options;
  options.views_per_marker = 3;
  const Map map = lineOfKeyframes(3);
  const std::vector<MarkerDetection> known = {seen(1)};
  Transform inside;
  inside.p.x() = 0.05;
  EXPECT_EQ(keyframeReason(map, known, inside, 0.5, false, options), KeyframeReason::kNone);
  Transform outside;
  outside.p.x() = 0.35;
  EXPECT_EQ(keyframeReason(map, known, outside, 0.5, false, options), KeyframeReason::kBaseline);
}

// A marker that moved has lost its views. Where keyframes from before are dense, new ones must come
// all the same, as far from each other as ever.
TEST(KeyframePolicy, AMarkerWithoutAPoseGetsViewsOfItsOwn) {
  Map map = lineOfKeyframes(9);
  map.quarantine(2);
  Transform here;
  here.p.x() = 0.42;
  const std::vector<MarkerDetection> known = {seen(1)};
  const std::vector<MarkerDetection> both = {seen(1), seen(2)};
  const auto reason = [&](const std::vector<MarkerDetection>& detections) {
    return keyframeReason(map, detections, here, 2.0, false, {});
  };
  EXPECT_EQ(reason(known), KeyframeReason::kNone);
  EXPECT_EQ(reason(both), KeyframeReason::kBaseline);
  (void)map.addKeyframe({-1, 0, 0, here, both});
  EXPECT_EQ(reason(both), KeyframeReason::kNone);
  here.p.x() = 0.52;  // more than 8 cm from the one that sees it
  EXPECT_EQ(reason(both), KeyframeReason::kBaseline);
  map.place(2, Transform{});
  EXPECT_EQ(reason(both), KeyframeReason::kNone);
}

TEST(KeyframePolicy, ReferenceIsTheNearestThatSeesAMarkerOfTheFrame) {
  const Map map = lineOfKeyframes(5, 1);
  Transform here;
  here.p = {0.31, 0.02, 0.0};
  const std::vector<MarkerDetection> first = {seen(1)};
  const std::vector<MarkerDetection> second = {seen(2)};
  EXPECT_EQ(referenceKeyframe(map, first, here, 1.0, {}), 3);
  EXPECT_EQ(referenceKeyframe(map, second, here, 1.0, {}), 1);
  EXPECT_EQ(referenceKeyframe(map, {}, here, 1.0, {}), std::nullopt);
}

}  // namespace
}  // namespace waymark::slam
