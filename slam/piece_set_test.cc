// Maps in pieces, by the whole loop on exact corners.
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/camera/undistort_map.h"
#include "slam/slam.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

constexpr double kPrint_m = 0.12;

// A wall, of which every frame is shown some columns only.
class PieceSetTest : public ::testing::Test {
 protected:
  PieceSetTest() {
    options_.markers.size_m = kPrint_m;
    options_.pieces.begin = true;
  }

  [[nodiscard]] static Transform cameraAt(int frame) {
    const double s = 0.08 * frame;
    return testing::lookAt({0.8 * std::sin(s), 0.4 * std::sin(0.7 * s), 0.2 * std::cos(1.3 * s)},
                           {0.2 * std::sin(s), 3.0, 0.0});
  }

  // Frames that show columns from `first` to before `end`. Those with a pose.
  int walk(int frames, int first, int end) {
    int localized = 0;
    for (int i = 0; i < frames; ++i) {
      const Transform T_w_c = cameraAt(frame_);
      std::vector<MarkerDetection> seen =
          testing::observeAll(camera_, T_w_c, markers_, kPrint_m, 0.05, &rng_);
      std::erase_if(seen, [&](const MarkerDetection& d) {
        return d.id % kColumns < first || d.id % kColumns >= end;
      });
      if (twice_) {
        const auto twin = testing::observe(camera_, T_w_c, kTwice, *twice_, kPrint_m, 0.05, &rng_);
        if (twin) seen.push_back(*twin);
      }
      last_ = slam().process(
          {.time = {static_cast<std::uint64_t>(frame_), frame_ * period_ns_}, .detections = seen});
      ++frame_;
      if (!last_.pose) continue;
      ++localized;
      poses_.push_back(*last_.pose);
      truth_.push_back(T_w_c);
    }
    return localized;
  }
  Slam& slam() {
    if (!slam_) slam_.emplace(camera_, *Dictionary::byName("APRILTAG_36h11"), options_);
    return *slam_;
  }
  [[nodiscard]] static std::size_t posedIn(const Map& map) {
    return static_cast<std::size_t>(std::ranges::count_if(
        map.markers(), [](const auto& entry) { return entry.second.T_w_m.has_value(); }));
  }
  // Of pairs of markers in one map.
  [[nodiscard]] double worstDistanceError(const Map& map) const {
    double worst = 0.0;
    for (const auto& [i, a] : map.markers()) {
      for (const auto& [j, b] : map.markers()) {
        if (!a.T_w_m || !b.T_w_m || i == kTwice || j == kTwice) continue;
        const auto& T_a = markers_[static_cast<std::size_t>(i)].T_w_m;
        const auto& T_b = markers_[static_cast<std::size_t>(j)].T_w_m;
        worst =
            std::max(worst, std::abs((a.T_w_m->p - b.T_w_m->p).norm() - (T_a.p - T_b.p).norm()));
      }
    }
    return worst;
  }

  static constexpr int kColumns = 6;
  static constexpr int kTwice = 90;
  std::optional<Transform> twice_;  // where its print hangs that is in view, if one is
  std::mt19937 rng_{3};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(3, kColumns, 0.35, &rng_);
  Options options_;
  std::int64_t period_ns_ = 500'000'000;  // 2 Hz: nothing is predicted over it
  std::optional<Slam> slam_;
  FrameResult last_;
  std::vector<PoseEstimate> poses_;
  std::vector<Transform> truth_;
  int frame_ = 0;
};

TEST_F(PieceSetTest, ACameraLostAmongUnknownMarkersGoesOnInANewPiece) {
  EXPECT_EQ(walk(10, 0, 3), 10);
  EXPECT_EQ(walk(10, 3, 6), 10);
  EXPECT_EQ(slam().pieces().size(), 2U);
  EXPECT_EQ(last_.pose->piece, 1);
  EXPECT_EQ(slam().counters().pieces_begun, 1U);
  EXPECT_EQ(walk(5, 0, 3), 5);
  EXPECT_EQ(last_.pose->piece, 0) << "back in the first one, without a frame lost";
  EXPECT_EQ(slam().pieces().size(), 2U);
  for (const Map* map : slam().pieces()) EXPECT_GE(posedIn(*map), 8U) << "of 9";
}

TEST_F(PieceSetTest, CarriedToAnotherRoomAndBackInTheDarkItHasAPoseAtOnce) {
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(walk(5, 0, 3), 5) << i;
    EXPECT_EQ(last_.pose->piece, 0) << i;
    EXPECT_EQ(walk(6, 0, 0), 0) << "dark";
    EXPECT_EQ(walk(5, 3, 6), 5) << i;
    EXPECT_EQ(last_.pose->piece, 1) << i;
    EXPECT_EQ(walk(6, 0, 0), 0) << "dark";
  }
  EXPECT_EQ(slam().pieces().size(), 2U);
}

TEST_F(PieceSetTest, WithoutPiecesItWaits) {
  options_.pieces.begin = false;
  EXPECT_EQ(walk(10, 0, 3), 10);
  EXPECT_EQ(walk(10, 3, 6), 0);
  EXPECT_EQ(slam().pieces().size(), 1U);
  EXPECT_EQ(slam().counters().pieces_begun, 0U);
}

// That the camera has a global shutter is found once, not in every room again.
TEST_F(PieceSetTest, ANewPieceKnowsTheShutter) {
  period_ns_ = 33'000'000;
  (void)walk(10, 0, 3);
  ASSERT_TRUE(isDoubted(slam().map())) << "nobody has told of it";
  (void)walk(60, 0, 3);
  ASSERT_FALSE(isDoubted(slam().map()));
  (void)walk(10, 3, 6);
  ASSERT_EQ(slam().pieces().size(), 2U);
  EXPECT_FALSE(isDoubted(*slam().pieces().back()));
}

TEST_F(PieceSetTest, FramesWithMarkersOfBothJoinTwoPieces) {
  (void)walk(10, 0, 3);
  (void)walk(10, 3, 6);
  EXPECT_EQ(walk(10, 0, 6), 10);
  ASSERT_EQ(slam().pieces().size(), 1U);
  EXPECT_EQ(slam().map().piece, 0) << "the older one stays";
  EXPECT_EQ(slam().counters().pieces_joined, 1U);
  EXPECT_EQ(last_.pose->piece, 0);
  slam().optimizeGlobally();
  EXPECT_EQ(posedIn(slam().map()), markers_.size());
  EXPECT_LT(worstDistanceError(slam().map()), 0.01);
  // What was told of the piece that is gone is told in the world of the one that is left.
  const Transform T_v_w = poses_.front().T_w_c * truth_.front().inverse();
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    const PoseEstimate now = slam().asOfNow(poses_[i]);
    EXPECT_EQ(now.piece, 0);
    EXPECT_LT((now.T_w_c.p - (T_v_w * truth_[i]).p).norm(), 0.08) << i;
  }
}

// Two pieces, and frames with markers of both, each of which has time for a little of a joint.
class PiecesInSlicesTest : public PieceSetTest {
 protected:
  PiecesInSlicesTest() {
    period_ns_ = 33'000'000;
    options_.work_per_frame = 2.0;
    options_.pieces.join_cost_per_frame = 2.0;
    (void)walk(15, 0, 3);
    (void)walk(15, 3, 6);
  }
  // Every frame has a pose, and no marker two places. How many frames the joint takes.
  int joinBy(int first) {
    const int most = 120;
    for (int i = 0; i < most; ++i) {
      EXPECT_EQ(walk(1, first, 6), 1) << i;
      std::map<int, int> places;
      for (const Map* map : slam().pieces()) {
        for (const auto& [id, marker] : map->markers()) places[id] += marker.T_w_m ? 1 : 0;
      }
      for (const auto& [id, count] : places) EXPECT_LE(count, 1) << "marker " << id;
      const bool joined = slam().counters().pieces_joined > 0;
      EXPECT_EQ(last_.pose->piece, joined ? 0 : 1) << i;
      if (joined) return i + 1;
    }
    return most;
  }
};

TEST_F(PiecesInSlicesTest, AJointIsSpreadOverFramesThatAllHaveAPose) {
  ASSERT_EQ(slam().pieces().size(), 2U);
  const int frames = joinBy(0);
  EXPECT_GT(frames, 10);
  EXPECT_LT(frames, 100);
  const PoseEstimate joined = *last_.pose;
  ASSERT_EQ(slam().pieces().size(), 1U);
  EXPECT_EQ(last_.piece_events.size(), 1U) << "in the frame in which they are one";
  // The map goes on growing, in one world.
  const std::size_t keyframes = slam().map().keyframes().size();
  EXPECT_EQ(walk(40, 0, 6), 40);
  EXPECT_GT(slam().map().keyframes().size(), keyframes);
  EXPECT_EQ(joined.piece, 0);
  slam().optimizeGlobally();
  EXPECT_EQ(posedIn(slam().map()), markers_.size());
  EXPECT_LT(worstDistanceError(slam().map()), 0.01);
}

// Markers of the other piece come into view meanwhile: what was made of the two is begun anew.
TEST_F(PiecesInSlicesTest, WhatChangesMeanwhileIsInTheJoint) {
  for (int first = 2; first > 0; --first) {
    (void)walk(4, first, 6);
    ASSERT_EQ(slam().pieces().size(), 2U);
  }
  EXPECT_LT(joinBy(0), 100);
  slam().optimizeGlobally();
  EXPECT_EQ(posedIn(slam().map()), markers_.size());
  EXPECT_LT(worstDistanceError(slam().map()), 0.01);
}

TEST_F(PiecesInSlicesTest, AtTheEndAJointUnderWayIsDone) {
  int frames = 0;
  const auto isHeld = [&] {
    const auto keyframes = slam().pieces().back()->keyframes().size();
    (void)walk(3, 0, 6);
    frames += 3;
    return slam().pieces().back()->keyframes().size() == keyframes;
  };
  while (frames < 60 && !isHeld()) {
  }
  ASSERT_EQ(slam().pieces().size(), 2U) << "under way";
  slam().finish();
  EXPECT_EQ(slam().pieces().size(), 1U);
  EXPECT_EQ(slam().counters().pieces_joined, 1U);
  EXPECT_EQ(walk(5, 0, 6), 5);
}

TEST_F(PieceSetTest, PiecesAreJoinedByMarkersThatOneFrameHasShownBefore) {
  (void)walk(10, 0, 3);
  (void)walk(6, 0, 4);  // the fourth column is known to the first piece
  (void)walk(10, 4, 6);
  ASSERT_EQ(slam().pieces().size(), 2U);
  (void)walk(4, 3, 6);
  EXPECT_EQ(slam().pieces().size(), 1U);
}

// A marker is in one piece, whichever way the camera goes between them.
TEST_F(PieceSetTest, NoMarkerHasTwoPlaces) {
  for (int i = 0; i < 30; ++i) {
    const int first = (5 * i) % 4;
    (void)walk(2, first, first + 2 + i % 2);
    std::map<int, int> places;
    for (const Map* map : slam().pieces()) {
      for (const auto& [id, marker] : map->markers()) places[id] += marker.T_w_m ? 1 : 0;
    }
    for (const auto& [id, count] : places) ASSERT_LE(count, 1) << "marker " << id;
  }
}

// An id that hangs in both rooms, seen with others that say how these lie to each other.
TEST_F(PieceSetTest, AnIdTwiceAmongOthersDoesNotJoinTwoRoomsWrongly) {
  twice_ = testing::markerFacing({-0.6, 3.0, 0.6}, {-0.4, 0.0, 0.3});
  (void)walk(10, 0, 3);
  ASSERT_NE(slam().map().findPosed(kTwice), nullptr);
  twice_.reset();
  (void)walk(6, 3, 6);
  ASSERT_EQ(slam().pieces().size(), 2U);
  twice_ = testing::markerFacing({0.7, 2.6, 0.5}, {0.1, 0.0, 0.6});
  for (int i = 0; i < 10; ++i) {
    (void)walk(2, 2, 5);
    for (const Map* map : slam().pieces()) EXPECT_LT(worstDistanceError(*map), 0.1) << i;
  }
}

// Two rooms that an id that hangs twice has joined: the door tells better, and both are what they
// were, with nothing lost of either.
TEST_F(PieceSetTest, AJointThatLaterFramesRefuteIsUndone) {
  options_.pieces.other_print.max_angle_rad = 1e-3;  // what would have refused it
  twice_ = testing::markerFacing({-0.6, 3.0, 0.6}, {-0.4, 0.0, 0.3});
  (void)walk(12, 0, 3);
  twice_.reset();
  (void)walk(8, 3, 6);
  ASSERT_EQ(slam().pieces().size(), 2U);
  twice_ = testing::markerFacing({0.7, 2.6, 0.5}, {0.1, 0.0, 0.6});
  (void)walk(20, 3, 6);
  ASSERT_EQ(slam().pieces().size(), 1U) << "joined wrongly";
  EXPECT_GT(worstDistanceError(slam().map()), 0.1);
  twice_.reset();
  std::vector<PieceEvent> events;
  std::optional<int> parted_after;
  for (int i = 0; i < 10 && !parted_after; ++i) {
    (void)walk(1, 2, 5);
    for (const PieceEvent& event : last_.piece_events) events.push_back(event);
    if (!events.empty()) parted_after = i + 1;
  }
  ASSERT_TRUE(parted_after);
  EXPECT_LE(*parted_after, 4);
  EXPECT_EQ(events.front().kind, PieceEvent::Kind::kParted);
  EXPECT_EQ(events.front().piece, 1);
  EXPECT_EQ(events.front().into, 0);
  EXPECT_EQ(slam().counters().pieces_parted, 1U);
  EXPECT_EQ(slam().counters().refused_markers, 1U) << "all rested on it";
  for (const Map* map : slam().pieces()) EXPECT_LT(worstDistanceError(*map), 0.1);
  (void)walk(20, 1, 5);
  ASSERT_EQ(slam().pieces().size(), 1U) << "by what is seen from both";
  EXPECT_LT(worstDistanceError(slam().map()), 0.05);
}

TEST_F(PieceSetTest, LocalizesInAllPiecesOfAMapThatStaysAsItIs) {
  (void)walk(10, 0, 3);
  (void)walk(10, 3, 6);
  slam().finish();
  const std::vector<const Map*> pieces = slam().pieces();
  ASSERT_EQ(pieces.size(), 2U);
  const Map first = *pieces[0];
  const std::vector<Map> others = {*pieces[1]};
  options_.mapping = false;
  slam_.emplace(camera_, *Dictionary::byName("APRILTAG_36h11"), options_, first, others);
  EXPECT_EQ(walk(5, 0, 3), 5);
  EXPECT_EQ(last_.pose->piece, 0);
  EXPECT_EQ(walk(5, 3, 6), 5);
  EXPECT_EQ(last_.pose->piece, 1);
  EXPECT_EQ(slam().pieces().size(), 2U);
}

}  // namespace
}  // namespace waymark::slam
