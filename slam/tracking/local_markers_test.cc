#include "slam/tracking/local_markers.h"

#include <gtest/gtest.h>

#include "slam/testing/seen_marker.h"

namespace waymark::slam {
namespace {

using testing::seen;

// A walk past the markers 0 to 5: keyframe i, at x = i metres, sees the markers i and i + 1.
class LocalMarkersTest : public ::testing::Test {
 protected:
  LocalMarkersTest() {
    for (int i = 0; i < 5; ++i) addKeyframe(i, {i, i + 1});
    for (int i = 0; i <= 5; ++i) detections_.push_back(seen(i));
  }

  void addKeyframe(double x_m, const std::vector<int>& ids) {
    Keyframe keyframe;
    keyframe.T_w_c.p.x() = x_m;
    for (const int id : ids) {
      map_.addMarker(id, 0.1);
      map_.place(id, Transform{});
      keyframe.detections.push_back(seen(id));
    }
    (void)map_.addKeyframe(std::move(keyframe));
  }

  // At x, the given markers fit.
  void follow(double x_m, const std::vector<int>& ids) {
    std::vector<MarkerDetection> fitting;
    for (const int id : ids) fitting.push_back(seen(id));
    Transform T_w_c;
    T_w_c.p.x() = x_m;
    local_.update(map_, fitting, T_w_c, 2.0, KeyframeOptions{});
  }

  using Ids = std::vector<int>;
  std::pair<Ids, Ids> split() {
    SplitMarkers markers;
    local_.split(knownMarkers(map_, detections_), &markers);
    const auto ids = [](const std::vector<KnownMarker>& known) {
      Ids list;
      for (const KnownMarker& marker : known) list.push_back(marker.detection->id);
      return list;
    };
    return {ids(markers.eligible), ids(markers.loop)};
  }

  Map map_;
  std::vector<MarkerDetection> detections_;
  LocalMarkers local_;
};

TEST_F(LocalMarkersTest, WithoutAReferenceAllAreEligible) {
  EXPECT_EQ(split(), (std::pair{Ids{0, 1, 2, 3, 4, 5}, Ids{}}));
  EXPECT_FALSE(local_.reference());
}

// Keyframe 4 sees the markers 4 and 5 and shares 4 with keyframe 3, which sees 3 and 4.
TEST_F(LocalMarkersTest, MarkersThatNoNeighbourSeesCloseALoop) {
  follow(4.1, {4, 5});
  EXPECT_EQ(local_.reference(), 4);
  EXPECT_EQ(split(), (std::pair{Ids{3, 4, 5}, Ids{0, 1, 2}}));
  follow(0.1, {0, 1});
  EXPECT_EQ(split(), (std::pair{Ids{0, 1, 2}, Ids{3, 4, 5}}));
  local_.reset();
  EXPECT_EQ(split().second, Ids{});
}

// Near by, but it sees none of what fits: behind a wall, or behind drift.
TEST_F(LocalMarkersTest, AKeyframeThatSeesNothingOfThisIsNoReference) {
  follow(0.0, {4, 5});
  EXPECT_EQ(local_.reference(), 3) << "the nearest of those that see 4 or 5";
  follow(0.0, {});
  EXPECT_FALSE(local_.reference());
}

// A new keyframe that sees both ends joins them.
TEST_F(LocalMarkersTest, ANewKeyframeWidensTheNeighbourhood) {
  follow(4.1, {4, 5});
  addKeyframe(6.0, {0, 5});
  follow(4.1, {4, 5});
  EXPECT_EQ(local_.reference(), 4);
  EXPECT_EQ(split(), (std::pair{Ids{0, 3, 4, 5}, Ids{1, 2}}));
}

}  // namespace
}  // namespace waymark::slam
