#include "slam/marker_screening/marker_screening.h"

#include <gtest/gtest.h>

#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

using testing::kFramePeriodNs;

class MarkerScreeningTest : public ::testing::Test {
 protected:
  static MarkerOptions markers() {
    MarkerOptions options;
    options.size_m = 0.1;
    options.ignored = {{50, 59}};
    return options;
  }

  // A detection around the image's middle, or elsewhere.
  static MarkerDetection seen(int id, const Eigen::Vector2d& middle_px = {320.0, 240.0}) {
    MarkerDetection detection;
    detection.id = id;
    const double d[4][2] = {{-9, -9}, {9, -9}, {9, 9}, {-9, 9}};
    for (std::size_t k = 0; k < 4; ++k) {
      detection.pixels[k] = middle_px + Eigen::Vector2d(d[k][0], d[k][1]);
    }
    return detection;
  }

  std::vector<int> screened(const std::vector<MarkerDetection>& detections) {
    std::vector<int> ids;
    for (const auto& d : screening_.screen(detections, camera_, map_, &counters_)) {
      ids.push_back(d.id);
    }
    return ids;
  }

  // A mapped marker with two views.
  void mapMarker(int id, const Transform& T_w_m) {
    map_.addMarker(id, 0.1);
    map_.place(id, T_w_m);
    for (int i = 0; i < 2; ++i) (void)map_.addKeyframe({-1, 0, 0, {}, {seen(id)}});
  }

  // The marker disagrees for as long as it takes, and is given another pose: a move.
  void disagree(int id, int frames = 60) {
    for (int i = 0; i < frames; ++i) screening_.record(id, false, i * kFramePeriodNs);
  }
  void moveTo(int id, const Transform& T_w_m) {
    disagree(id);
    ASSERT_TRUE(screening_.quarantineMoved(&map_, &counters_));
    ASSERT_EQ(map_.find(id)->state, MarkerState::kQuarantined);
    map_.place(id, T_w_m);
    screening_.checkReturned(id, &map_, &counters_);
  }

  static Transform at(double x_m) { return {Eigen::Matrix3d::Identity(), {x_m, 0.0, 2.0}}; }

  CameraModel camera_{testing::testCalibration()};
  MarkerScreening screening_{markers(), MarkerScreeningOptions{}};
  Map map_;
  Counters counters_;
};

TEST_F(MarkerScreeningTest, ScreensOutWhatCannotBeUsed) {
  map_.addMarker(9, 0.1);
  map_.ban(9);
  const std::vector<MarkerDetection> detections = {
      seen(8), seen(3), seen(55), seen(9), seen(4, {8.0, 240.0}), seen(5, {320.0, 475.0}),
      seen(6), seen(2), seen(6),
  };
  EXPECT_EQ(screened(detections), (std::vector<int>{2, 3, 8})) << "sorted by id";
  EXPECT_EQ(counters_.clipped_markers, 2U);
  EXPECT_EQ(counters_.doubled_markers, 1U);
  EXPECT_TRUE(screened({}).empty());
}

TEST_F(MarkerScreeningTest, AnIdSeenTwiceAgainAndAgainIsRejected) {
  mapMarker(6, at(0.0));
  const int needed = MarkerScreeningOptions{}.doubled_frames;
  for (int i = 1; i < needed; ++i) {
    (void)screened({seen(6), seen(6)});
    EXPECT_FALSE(screening_.banDuplicates(&map_, &counters_)) << "may be a misread code";
  }
  (void)screened({seen(6), seen(6)});
  EXPECT_TRUE(screening_.banDuplicates(&map_, &counters_));
  EXPECT_EQ(map_.find(6)->state, MarkerState::kBanned);
  EXPECT_EQ(map_.findPosed(6), nullptr);
  EXPECT_TRUE(map_.viewsOf(6).empty());
  EXPECT_EQ(counters_.refused_markers, 1U);
  EXPECT_FALSE(screening_.banDuplicates(&map_, &counters_)) << "once is enough";
  EXPECT_TRUE(screened({seen(6)}).empty());
}

// Frames without a pose change no map: what they have shown counts in the next one with a pose.
TEST_F(MarkerScreeningTest, AnIdSeenTwiceTooOftenWithoutAPoseIsRejectedWithTheNextPose) {
  mapMarker(6, at(0.0));
  for (int i = 0; i < MarkerScreeningOptions{}.doubled_frames + 2; ++i) {
    (void)screened({seen(6), seen(6)});
  }
  EXPECT_TRUE(screening_.banDuplicates(&map_, &counters_));
  EXPECT_EQ(map_.find(6)->state, MarkerState::kBanned);
  EXPECT_EQ(counters_.refused_markers, 1U);
  EXPECT_FALSE(screening_.banDuplicates(&map_, &counters_)) << "once is enough";
}

// Also where the map has not heard of it yet.
TEST_F(MarkerScreeningTest, ADoubledMarkerIsRejectedBeforeItIsMapped) {
  for (int i = 0; i < MarkerScreeningOptions{}.doubled_frames; ++i)
    (void)screened({seen(6), seen(6)});
  EXPECT_TRUE(screening_.banDuplicates(&map_, &counters_));
  EXPECT_EQ(map_.find(6)->state, MarkerState::kBanned);
}

// Ignored ids are not looked at, not even to count them.
TEST_F(MarkerScreeningTest, ADoubledIgnoredMarkerLeavesNoTrace) {
  for (int i = 0; i < 2 * MarkerScreeningOptions{}.doubled_frames; ++i) {
    EXPECT_TRUE(screened({seen(55), seen(55)}).empty());
  }
  EXPECT_FALSE(screening_.banDuplicates(&map_, &counters_));
  EXPECT_EQ(map_.find(55), nullptr);
  EXPECT_EQ(counters_.doubled_markers, 0U);
}

TEST_F(MarkerScreeningTest, AMovedMarkerIsQuarantined) {
  mapMarker(1, at(0.0));
  mapMarker(2, at(1.0));
  disagree(1);
  EXPECT_TRUE(screening_.quarantineMoved(&map_, &counters_));
  const MapMarker& moved = *map_.find(1);
  EXPECT_EQ(moved.state, MarkerState::kQuarantined);
  EXPECT_FALSE(moved.T_w_m);
  EXPECT_TRUE(map_.viewsOf(1).empty());
  ASSERT_EQ(moved.former_poses.size(), 1U);
  EXPECT_EQ(moved.former_poses[0].p, at(0.0).p);
  EXPECT_NE(map_.findPosed(2), nullptr);
  EXPECT_EQ(map_.viewsOf(2).size(), 2U);
  EXPECT_EQ(counters_.quarantined_markers, 1U);
  EXPECT_FALSE(screening_.quarantineMoved(&map_, &counters_)) << "nothing disagrees any more";
}

TEST_F(MarkerScreeningTest, ABriefDisagreementIsForgiven) {
  const MarkerScreeningOptions options;
  mapMarker(1, at(0.0));
  disagree(1, options.moved_frames - 1);
  EXPECT_FALSE(screening_.quarantineMoved(&map_, &counters_)) << "too few frames";
  screening_.record(1, true, options.moved_frames * kFramePeriodNs);
  disagree(1, options.moved_frames - 1);
  EXPECT_FALSE(screening_.quarantineMoved(&map_, &counters_)) << "a fit in between starts over";
  // Many frames, but all within a blink (a fast camera).
  screening_.record(1, true, 0);
  for (int i = 0; i < 10 * options.moved_frames; ++i) screening_.record(1, false, i * 1'000'000);
  EXPECT_FALSE(screening_.quarantineMoved(&map_, &counters_)) << "too short a time";
  EXPECT_EQ(counters_.quarantined_markers, 0U);
}

TEST_F(MarkerScreeningTest, ACorrectedMapStartsOver) {
  mapMarker(1, at(0.0));
  EXPECT_FALSE(screening_.suspectsMoved(map_));
  disagree(1);
  EXPECT_TRUE(screening_.suspectsMoved(map_));
  screening_.forgetDisagreements();
  EXPECT_FALSE(screening_.suspectsMoved(map_));
  EXPECT_FALSE(screening_.quarantineMoved(&map_, &counters_));
  EXPECT_NE(map_.findPosed(1), nullptr);
}

// Through a wrong lens a marker seems to move, and to be back as the map bends: once the lens is
// known, that is no reason to reject it.
TEST_F(MarkerScreeningTest, WhatAnotherLensHasMovedIsForgotten) {
  mapMarker(1, at(0.0));
  disagree(1);
  EXPECT_TRUE(screening_.quarantineMoved(&map_, &counters_));
  map_.place(1, at(0.5));
  disagree(1);
  screening_.forgetMoves(&map_);
  EXPECT_FALSE(screening_.quarantineMoved(&map_, &counters_));
  map_.place(1, at(0.0));
  screening_.checkReturned(1, &map_, &counters_);
  EXPECT_NE(map_.findPosed(1), nullptr);
}

TEST_F(MarkerScreeningTest, AMoveToANewPlaceIsNoReasonToReject) {
  mapMarker(1, at(0.0));
  moveTo(1, at(0.3));
  EXPECT_EQ(map_.find(1)->state, MarkerState::kMapped);
  moveTo(1, at(0.6));
  EXPECT_EQ(map_.find(1)->state, MarkerState::kMapped);
  EXPECT_EQ(counters_.refused_markers, 0U);
}

TEST_F(MarkerScreeningTest, AMoveOfALittleIsNotAReturn) {
  mapMarker(1, at(0.0));
  moveTo(1, at(0.02));
  EXPECT_EQ(map_.find(1)->state, MarkerState::kMapped);
}

// Two prints of one id: the marker is here, then there, then here again.
TEST_F(MarkerScreeningTest, AMarkerThatReturnsIsRejected) {
  mapMarker(1, at(0.0));
  moveTo(1, at(2.0));
  moveTo(1, at(0.01));
  EXPECT_EQ(map_.find(1)->state, MarkerState::kBanned);
  EXPECT_EQ(map_.findPosed(1), nullptr);
  EXPECT_EQ(counters_.refused_markers, 1U);
}

// The same place, but turned: somebody hung it up again the other way round.
TEST_F(MarkerScreeningTest, TheSamePlaceTurnedIsAnotherPose) {
  mapMarker(1, at(0.0));
  moveTo(1, at(2.0));
  moveTo(1, {expSo3({0.0, 0.0, 1.0}), at(0.0).p});
  EXPECT_EQ(map_.find(1)->state, MarkerState::kMapped);
}

TEST_F(MarkerScreeningTest, AMarkerThatNeverStaysIsRejected) {
  mapMarker(1, at(0.0));
  for (int i = 1; i <= MarkerScreeningOptions{}.max_moves; ++i) moveTo(1, at(i));
  disagree(1);
  EXPECT_TRUE(screening_.quarantineMoved(&map_, &counters_));
  EXPECT_EQ(map_.find(1)->state, MarkerState::kBanned);
}

}  // namespace
}  // namespace waymark::slam
