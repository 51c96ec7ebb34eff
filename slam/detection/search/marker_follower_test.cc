#include "slam/detection/search/marker_follower.h"

#include <gtest/gtest.h>

#include "slam/testing/drawn_marker.h"

namespace waymark::slam {
namespace {

constexpr std::int64_t kFrame_ns = 10'000'000;

// A light wall with markers that move from frame to frame, without a map.
class MarkerFollowerTest : public ::testing::Test {
 protected:
  struct Placed {
    int id;
    int left;
    int top;
  };

  static constexpr int kCell_px = 5;

  void draw(const Placed& marker) {
    testing::drawMarker(dictionary_, marker.id, marker.left, marker.top, kCell_px, 0, &wall_);
  }
  // One more frame, with these markers.
  const std::vector<MarkerDetection>& show(const std::vector<Placed>& markers,
                                           std::span<const ExpectedMarker> expected = {}) {
    wall_ = testing::Picture(camera_.width(), camera_.height(), 210);
    for (const Placed& marker : markers) draw(marker);
    time_ns_ += kFrame_ns;
    return follower_.find(wall_.view(), time_ns_, expected);
  }
  // Of the top-left corner, pixels.
  static double error(const MarkerDetection& detection, const Placed& truth) {
    return (detection.pixels[0] - Eigen::Vector2d(truth.left - 0.5, truth.top - 0.5)).norm();
  }
  [[nodiscard]] std::array<Eigen::Vector2d, 4> corners(const Placed& marker) const {
    const double side = kCell_px * dictionary_.cells();
    std::array<Eigen::Vector2d, 4> pixels = {Eigen::Vector2d(0, 0), Eigen::Vector2d(side, 0),
                                             Eigen::Vector2d(side, side), Eigen::Vector2d(0, side)};
    for (auto& p : pixels) p += Eigen::Vector2d(marker.left - 0.5, marker.top - 0.5);
    return *undistortCorners(camera_, pixels);
  }

  CameraModel camera_{
      Calibration{.width = 640, .height = 480, .fx = 520.0, .fy = 520.0, .cx = 319.5, .cy = 239.5}};
  Dictionary dictionary_ = *Dictionary::byName("ARUCO_MIP_36h12");
  MarkerFollower follower_{camera_, dictionary_, {}, {}};
  testing::Picture wall_{camera_.width(), camera_.height(), 210};
  std::int64_t time_ns_ = 0;
};

TEST_F(MarkerFollowerTest, MovingMarkersAreFollowedThroughTheImage) {
  for (int frame = 0; frame < 40; ++frame) {
    const Placed a{3, 100 + 6 * frame, 80};
    const Placed b{7, 150 + 6 * frame, 200};
    const auto& found = show({a, b});
    ASSERT_EQ(found.size(), 2U) << frame;
    EXPECT_EQ(follower_.mode(), frame == 0 ? SearchMode::kFullScan : SearchMode::kFollowing);
    EXPECT_LT(error(found[0], a), 0.05) << frame;
    EXPECT_LT(error(found[1], b), 0.05) << frame;
  }
}

TEST_F(MarkerFollowerTest, AJumpWithinTheSearchedSurroundingsLosesNothing) {
  (void)show({{3, 100, 80}});
  (void)show({{3, 100, 80}});
  const auto& found = show({{3, 112, 71}});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(follower_.mode(), SearchMode::kFollowing);
  EXPECT_LT(error(found[0], {3, 112, 71}), 0.05);
}

TEST_F(MarkerFollowerTest, AfterAJumpAcrossTheImageTheWholeIsScannedAtOnce) {
  (void)show({{3, 100, 80}, {7, 200, 200}});
  const auto& found = show({{3, 400, 180}, {7, 500, 300}});
  EXPECT_EQ(follower_.mode(), SearchMode::kFullScan);
  EXPECT_EQ(found.size(), 2U);
}

// So much comes into view that turns would be too late.
TEST_F(MarkerFollowerTest, FastMotionIsScannedAsAWhole) {
  (void)show({{3, 100, 80}});
  for (int frame = 1; frame < 10; ++frame) {
    const auto& found = show({{3, 100 + 24 * frame, 80}, {20 + frame, 20, 300}});
    EXPECT_EQ(found.size(), 2U) << frame;
    EXPECT_EQ(follower_.mode(), SearchMode::kFullScan);
  }
}

TEST_F(MarkerFollowerTest, ANewMarkerIsFoundInTime) {
  constexpr int kRound = 10;  // frames in 0.1 s
  (void)show({{3, 100, 80}});
  int frames = 0;
  while (show({{3, 100, 80}, {9, 400, 300}}).size() < 2 && frames < 100) ++frames;
  EXPECT_LE(frames, kRound);
  EXPECT_EQ(follower_.mode(), SearchMode::kFollowing);
}

// The map knows of it: it need not wait for its turn.
TEST_F(MarkerFollowerTest, AnExpectedMarkerIsFoundAtOnce) {
  (void)show({{3, 100, 80}});
  (void)show({{3, 100, 80}});
  const Placed newcomer{9, 400, 300};
  Placed guess = newcomer;
  guess.left += 1;
  const ExpectedMarker expected{9, corners(guess), corners(guess)};
  const auto& found = show({{3, 100, 80}, newcomer}, {&expected, 1});
  ASSERT_EQ(found.size(), 2U);
  EXPECT_LT(error(found[1], newcomer), 0.05);
}

TEST_F(MarkerFollowerTest, TheMapsMotionCountsMoreThanTheImages) {
  (void)show({{3, 100, 80}});
  (void)show({{3, 100, 80}});  // at rest until now
  const ExpectedMarker expected{3, corners({3, 102, 81}), corners({3, 120, 87})};
  const auto& found = show({{3, 118, 86}}, {&expected, 1});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(follower_.mode(), SearchMode::kFollowing);
}

TEST_F(MarkerFollowerTest, TwoPrintsOfOneIdAreFollowedBoth) {
  (void)show({{3, 100, 80}, {4, 300, 80}});
  for (int frame = 0; frame < 60; ++frame) {
    const auto& found = show({{3, 100 + frame, 80}, {3, 400 - frame, 300}, {4, 300, 80}});
    if (frame < 20) continue;  // the second one needs its turn to be found
    ASSERT_EQ(found.size(), 3U) << frame;
    EXPECT_EQ(found[0].id, 3);
    EXPECT_EQ(found[1].id, 3);
    EXPECT_EQ(found[2].id, 4);
    EXPECT_EQ(follower_.mode(), SearchMode::kFollowing) << frame;
  }
}

TEST_F(MarkerFollowerTest, WhatLeavesTheImageIsForgotten) {
  (void)show({{3, 100, 80}, {4, 300, 80}});
  EXPECT_EQ(show({{3, 100, 80}}).size(), 1U);
  EXPECT_EQ(follower_.followed().size(), 1U);
  EXPECT_TRUE(show({}).empty());
  EXPECT_TRUE(follower_.followed().empty());
}

TEST_F(MarkerFollowerTest, WithoutFollowingEveryFrameIsScanned) {
  FollowerOptions options;
  options.enabled = false;
  MarkerFollower scanner(camera_, dictionary_, {}, options);
  draw({3, 100, 80});
  for (int frame = 1; frame < 5; ++frame) {
    EXPECT_EQ(scanner.find(wall_.view(), frame * kFrame_ns, {}).size(), 1U);
    EXPECT_EQ(scanner.mode(), SearchMode::kFullScan);
  }
}

}  // namespace
}  // namespace waymark::slam
