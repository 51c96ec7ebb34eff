#include "tools/maps/map_merge.h"

#include <random>
#include <string>

#include <gtest/gtest.h>

#include "slam/optimization/map_optimizer.h"
#include "slam/testing/synthetic.h"

namespace waymark::tools {
namespace {

using slam::Transform;
using slam::testing::SyntheticMarker;

constexpr double kSize_m = 0.2;

// A wall of 4 x 8 markers, mapped by two runs that overlap: columns 0 to 4, and 3 to 7 in a world
// of its own.
class Merge : public ::testing::Test {
 protected:
  Merge() : wall_(slam::testing::markerWall(4, 8, 0.5, &rng_)) {
    a_ = mapOf(0, 4, Transform{}, -1.5);
    slam::Vector6d delta;
    delta << 3.0, -1.0, 0.5, 0.4, 2.0, -0.3;
    T_b_a_ = Transform{}.retract(delta);
    b_ = mapOf(3, 7, T_b_a_, 1.5);
  }

  io::MapFile mapOf(int first_column, int last_column, const Transform& T_v_w, double x_m) {
    io::MapFile file;
    file.camera = slam::testing::testCalibration();
    file.map.dictionary = "4X4_50";
    std::vector<SyntheticMarker> seen;
    for (const SyntheticMarker& marker : wall_) {
      const int column = marker.id % 8;
      if (column < first_column || column > last_column) continue;
      file.map.addMarker(marker.id, kSize_m);
      file.map.place(marker.id, marker.T_w_m);
      seen.push_back(marker);
    }
    const slam::CameraModel camera(*file.camera);
    for (int i = 0; i < 4; ++i) {
      slam::Keyframe keyframe;
      keyframe.sequence = static_cast<std::uint64_t>(i);
      keyframe.T_w_c =
          slam::testing::lookAt({x_m + 0.3 * i - 0.45, -0.5, 0.2 * (i % 2)}, {x_m, 3.0, 0.0});
      keyframe.detections =
          slam::testing::observeAll(camera, keyframe.T_w_c, seen, kSize_m, 0.05, &rng_);
      file.map.addKeyframe(keyframe);
    }
    file.map.moveWorld(T_v_w);
    return file;
  }

  static void shift(io::MapFile* file, int id, const Eigen::Vector3d& by_m) {
    Transform T_w_m = *file->map.find(id)->T_w_m;
    T_w_m.p += by_m;
    file->map.place(id, T_w_m);
  }

  std::mt19937 rng_{11};
  std::vector<SyntheticMarker> wall_;
  io::MapFile a_;
  io::MapFile b_;
  Transform T_b_a_;
};

TEST_F(Merge, JoinsByTheSharedMarkers) {
  const auto report = mergeMaps(&a_, b_, {});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->agreeing, (std::vector<int>{3, 4, 11, 12, 19, 20, 27, 28}));
  EXPECT_TRUE(report->disagreeing.empty());
  EXPECT_EQ(report->added.size(), 12U);
  EXPECT_LT(report->rms_m, 1e-9);
  EXPECT_LT((T_b_a_ * report->T_a_b).p.norm(), 1e-9);
  ASSERT_EQ(a_.map.markers().size(), 32U);
  for (const SyntheticMarker& marker : wall_) {
    EXPECT_LT((a_.map.find(marker.id)->T_w_m->p - marker.T_w_m.p).norm(), 1e-9);
  }
  ASSERT_EQ(a_.map.keyframes().size(), 8U);
  EXPECT_EQ(a_.map.keyframes().rbegin()->first, 7);
  EXPECT_EQ(a_.map.viewsOf(3).size(), a_.map.viewsOf(4).size());
  // And the keyframes of both are of use together: a marker put wrong is put right.
  shift(&a_, 7, {0.0, 0.01, 0.0});
  slam::optimizeGlobally(&a_.map, {.size_m = kSize_m}, {.max_iterations = 30});
  EXPECT_LT((a_.map.find(7)->T_w_m->p - wall_[7].T_w_m.p).norm(), 0.003);
}

TEST_F(Merge, MarkersThatMovedAreNamed) {
  shift(&b_, 11, {0.4, 0.0, 0.0});
  shift(&b_, 28, {-0.3, 0.0, 0.0});
  const auto report = mergeMaps(&a_, b_, {});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->disagreeing, (std::vector<int>{11, 28}));
  EXPECT_LT(report->rms_m, 1e-9);
  // Where a has them; and b's keyframes say nothing about them.
  EXPECT_LT((a_.map.find(11)->T_w_m->p - wall_[11].T_w_m.p).norm(), 1e-9);
  for (const slam::KeyframeId id : a_.map.viewsOf(11)) EXPECT_LT(id, 4);
  EXPECT_FALSE(a_.map.viewsOf(11).empty());
}

TEST_F(Merge, LinksComeWithTheirKeyframes) {
  const Transform T_c_m{slam::expSo3({0.1, 0.0, 0.0}), {0.3, 0.0, 0.0}};
  const int linked = b_.map.markers().begin()->first;
  b_.map.addLink(3, {linked, T_c_m, slam::Matrix6d::Identity()});
  (void)b_.map.addKeyframe({});
  ASSERT_TRUE(mergeMaps(&a_, b_, {}));
  ASSERT_EQ(a_.map.keyframes().size(), 8U) << "one that says nothing is left out";
  const auto& links = a_.map.keyframes().at(7).links;
  ASSERT_EQ(links.size(), 1U);
  EXPECT_EQ(links[0].marker, linked);
  EXPECT_EQ(links[0].T_c_m.p, T_c_m.p) << "whatever the world";
}

TEST_F(Merge, LinksToWhatHangsElsewhereStayBehind) {
  shift(&b_, 11, {0.5, 0.0, 0.0});
  b_.map.addLink(3, {11, {}, slam::Matrix6d::Identity()});
  ASSERT_TRUE(mergeMaps(&a_, b_, {}));
  EXPECT_TRUE(a_.map.keyframes().at(7).links.empty());
}

TEST_F(Merge, TooFewThatAgree) {
  for (const int id : {3, 4, 11, 12, 19}) shift(&b_, id, {0.2 + 0.1 * id, 0.0, 0.0});
  const slam::Map before = a_.map;
  const auto report = mergeMaps(&a_, b_, {});
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().message,
            "too few shared markers agree within 0.05 m: of 8 agree: 20, 27, 28; disagree: 3, 4, "
            "11, 12, 19");
  EXPECT_EQ(io::formatMap(a_.map, a_.camera), io::formatMap(before, a_.camera));
}

TEST_F(Merge, NothingShared) {
  io::MapFile other = mapOf(5, 7, T_b_a_, 1.5);
  const auto report = mergeMaps(&a_, other, {});
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().message,
            "too few shared markers agree within 0.05 m: of 0 agree: none; disagree: none");
}

TEST_F(Merge, DifferentMarkers) {
  slam::MapMarker larger = *b_.map.find(4);
  larger.size_m = 0.3;
  ASSERT_TRUE(b_.map.putMarker(larger));
  EXPECT_EQ(mergeMaps(&a_, b_, {}).error().message,
            "marker 4 has a side of 0.2 m in one map, 0.3 m in the other");
  b_.map.dictionary = "5X5_50";
  EXPECT_EQ(mergeMaps(&a_, b_, {}).error().message,
            "the maps have different dictionaries: 4X4_50, 5X5_50");
}

TEST_F(Merge, AnotherCamera) {
  b_.camera->fx *= 1.5;
  EXPECT_NE(mergeMaps(&a_, b_, {}).error().message.find("camera: is another one"),
            std::string::npos);
}

TEST_F(Merge, StatesOfMarkers) {
  // Rejected here: stays so. Rejected there: its views are not wanted. Unknown here: theirs.
  a_.map.ban(3);
  b_.map.ban(4);
  slam::MapMarker unresolved;
  unresolved.id = 12;
  unresolved.size_m = kSize_m;
  ASSERT_TRUE(a_.map.putMarker(unresolved));
  const auto report = mergeMaps(&a_, b_, {});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(a_.map.find(3)->state, slam::MarkerState::kBanned);
  for (const slam::KeyframeId id : a_.map.viewsOf(3)) EXPECT_LT(id, 4);
  EXPECT_EQ(a_.map.find(4)->state, slam::MarkerState::kMapped);
  for (const slam::KeyframeId id : a_.map.viewsOf(4)) EXPECT_LT(id, 4);
  EXPECT_EQ(a_.map.find(12)->state, slam::MarkerState::kMapped);
  EXPECT_LT((a_.map.find(12)->T_w_m->p - wall_[12].T_w_m.p).norm(), 1e-9);
}

Transform elsewhere(double by) {
  slam::Vector6d delta;
  delta << by, 1.0, -by, 0.1 * by, -1.0, 0.2;
  return Transform{}.retract(delta);
}

// Two pieces, and a map that reaches from one to the other.
TEST_F(Merge, WhatSharesMarkersWithTwoPiecesJoinsThem) {
  io::MapFile a = mapOf(0, 2, Transform{}, -1.5);
  a.other_pieces.push_back(mapOf(5, 7, elsewhere(2.0), 1.5).map);
  a.other_pieces.front().piece = 3;
  slam::MapMarker seen;  // the first piece's keyframes have, and know that the other one has it
  seen.id = 5;
  seen.size_m = kSize_m;
  seen.state = slam::MarkerState::kElsewhere;
  ASSERT_TRUE(a.map.putMarker(seen));
  const io::MapFile b = mapOf(2, 5, elsewhere(4.0), 0.0);
  const auto report = mergeMaps(&a, b, {});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->pieces_joined, 1);
  EXPECT_EQ(report->bridged, 1);
  EXPECT_EQ(report->pieces_apart, 0);
  EXPECT_TRUE(a.other_pieces.empty());
  ASSERT_EQ(a.map.markers().size(), 32U);
  for (const SyntheticMarker& marker : wall_) {
    EXPECT_LT((a.map.find(marker.id)->T_w_m->p - marker.T_w_m.p).norm(), 1e-9) << marker.id;
  }
  EXPECT_EQ(a.map.keyframes().size(), 12U);
}

TEST_F(Merge, WhatSharesTooLittleStaysAPieceOfItsOwn) {
  io::MapFile a = mapOf(0, 3, Transform{}, -1.5);
  io::MapFile b = mapOf(5, 7, elsewhere(2.0), 1.5);
  b.other_pieces.push_back(mapOf(2, 4, elsewhere(4.0), 0.0).map);
  b.other_pieces.front().piece = 1;
  slam::MapMarker shared = *b.map.find(5);  // one marker is not enough to agree by
  shared.id = 0;
  ASSERT_TRUE(b.map.putMarker(shared));
  const auto report = mergeMaps(&a, b, {});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->pieces_joined, 1);
  EXPECT_EQ(report->pieces_apart, 1);
  ASSERT_EQ(a.other_pieces.size(), 1U);
  EXPECT_EQ(a.other_pieces.front().piece, 1);
  EXPECT_EQ(a.map.markers().size(), 20U);
  EXPECT_EQ(report->added.size(), 4U + 12U);
  EXPECT_EQ(a.other_pieces.front().find(0)->state, slam::MarkerState::kElsewhere);
  // As a file has it: a marker has a place in one piece only.
  const slam::Map* const apart = &a.other_pieces.front();
  const std::string text = io::formatMap(a.map, a.camera, 0.0, {}, {&apart, 1});
  EXPECT_TRUE(io::parseMap(text, "merged.json"))
      << io::parseMap(text, "merged.json").error().message;
}

TEST_F(Merge, PiecesThatShareNothingAreNoMap) {
  io::MapFile a = mapOf(0, 2, Transform{}, -1.5);
  const io::MapFile before = a;
  io::MapFile b = mapOf(3, 4, elsewhere(2.0), 0.0);
  b.other_pieces.push_back(mapOf(5, 7, elsewhere(4.0), 1.5).map);
  EXPECT_FALSE(mergeMaps(&a, b, {}));
  EXPECT_TRUE(a.other_pieces.empty());
  EXPECT_EQ(a.map.markers().size(), before.map.markers().size());
}

}  // namespace
}  // namespace waymark::tools
