#include "slam/keyframes/keyframe_culler.h"

#include <random>
#include <set>

#include <gtest/gtest.h>

#include "slam/keyframes/farthest_views.h"
#include "slam/testing/seen_marker.h"

namespace waymark::slam {
namespace {

using testing::lineOfKeyframes;
using testing::seen;

TEST(KeyframeCuller, CullingKeepsTheMostDistantViewsAndTheFirst) {
  Map map = lineOfKeyframes(21);
  KeyframeOptions options;
  options.views_per_marker = 5;
  KeyframeCuller culler(options);
  EXPECT_EQ(culler.cull(&map, 20), 16);
  ASSERT_EQ(map.keyframes().size(), 5U);
  EXPECT_EQ(map.keyframes().begin()->first, 0);
  EXPECT_EQ(map.keyframes().rbegin()->first, 20);
  EXPECT_EQ(map.keyframes().count(10), 1U);  // the middle one is the farthest from both ends
  // Nothing to do the second time.
  EXPECT_EQ(culler.cull(&map, 20), 0);
}

TEST(KeyframeCuller, CullingLeavesAMarkerItsOnlyViews) {
  Map map = lineOfKeyframes(21, 7);
  KeyframeOptions options;
  options.views_per_marker = 3;
  KeyframeCuller culler(options);
  (void)culler.cull(&map, 20);
  EXPECT_EQ(map.keyframes().count(7), 1U);
  EXPECT_EQ(map.viewsOf(2).size(), 1U);
}

// What stays, by the words of section 4.6: all markers that neighbours see choose, from scratch.
std::set<KeyframeId> whatStays(const Map& map, KeyframeId newest, int views_per_marker) {
  std::set<KeyframeId> chosen = {newest, map.keyframes().begin()->first};
  const std::vector<KeyframeId> near = map.neighbours(newest);
  for (const int id : map.markersSeenFrom(near)) {
    const auto views = map.viewsOf(id);
    ViewArena arena;
    const auto count = static_cast<std::size_t>(views_per_marker);
    for (const std::size_t i : farthestViews(viewPositions(map, views, &arena), count, &arena)) {
      chosen.insert(views[i]);
    }
  }
  std::set<KeyframeId> left;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const bool is_near = std::ranges::binary_search(near, id);
    if (!is_near || chosen.contains(id) || !keyframe.links.empty()) left.insert(id);
  }
  return left;
}

TEST(KeyframeCuller, RemembersWhatMarkersChoseAsIfTheyChoseAnew) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> place(-3.0, 3.0);
  std::uniform_int_distribution<int> any_marker(0, 19);
  KeyframeOptions options;
  options.views_per_marker = 4;
  KeyframeCuller culler(options);
  Map map;
  for (int id = 0; id < 20; ++id) map.addMarker(id, 0.1);
  int removed = 0;
  for (int i = 0; i < 300; ++i) {
    Keyframe keyframe;
    keyframe.T_w_c.p = {place(random), place(random), place(random)};
    const int first = any_marker(random);
    std::set<int> ids;
    for (int k = 0; k < 4; ++k) ids.insert((first + k * k) % 20);
    for (const int id : ids) keyframe.detections.push_back(seen(id));
    const KeyframeId newest = map.addKeyframe(keyframe);
    if (i % 50 == 49) {  // a chosen view is found wrong
      const int marker = any_marker(random);
      const std::vector<KeyframeId> gone = {map.viewsOf(marker).front()};
      map.removeViews(marker, gone);
    }
    const std::set<KeyframeId> expected = whatStays(map, newest, options.views_per_marker);
    removed += culler.cull(&map, newest);
    std::set<KeyframeId> left;
    for (const auto& [id, known] : map.keyframes()) left.insert(id);
    ASSERT_EQ(left, expected) << "keyframe " << i;
  }
  EXPECT_GT(removed, 200);
}

}  // namespace
}  // namespace waymark::slam
