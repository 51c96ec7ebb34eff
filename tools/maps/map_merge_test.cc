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
      slam::MapMarker& mapped = file.map.addMarker(marker.id, kSize_m);
      mapped.T_w_m = marker.T_w_m;
      mapped.state = slam::MarkerState::kMapped;
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

  void shift(io::MapFile* file, int id, double by_m) {
    file->map.marker(id).T_w_m->p += Eigen::Vector3d(by_m, 0.0, 0.0);
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
  a_.map.marker(7).T_w_m->p.y() += 0.01;
  slam::optimizeGlobally(&a_.map, {.size_m = kSize_m}, {.max_iterations = 30});
  EXPECT_LT((a_.map.find(7)->T_w_m->p - wall_[7].T_w_m.p).norm(), 0.003);
}

TEST_F(Merge, MarkersThatMovedAreNamed) {
  shift(&b_, 11, 0.4);
  shift(&b_, 28, -0.3);
  const auto report = mergeMaps(&a_, b_, {});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(report->disagreeing, (std::vector<int>{11, 28}));
  EXPECT_LT(report->rms_m, 1e-9);
  // Where a has them; and b's keyframes say nothing about them.
  EXPECT_LT((a_.map.find(11)->T_w_m->p - wall_[11].T_w_m.p).norm(), 1e-9);
  for (const slam::KeyframeId id : a_.map.viewsOf(11)) EXPECT_LT(id, 4);
  EXPECT_FALSE(a_.map.viewsOf(11).empty());
}

TEST_F(Merge, TooFewThatAgree) {
  for (const int id : {3, 4, 11, 12, 19}) shift(&b_, id, 0.2 + 0.1 * id);
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
  b_.map.marker(4).size_m = 0.3;
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
  a_.map.marker(3).state = slam::MarkerState::kBanned;
  a_.map.marker(3).T_w_m.reset();
  b_.map.marker(4).state = slam::MarkerState::kBanned;
  b_.map.marker(4).T_w_m.reset();
  a_.map.marker(12).state = slam::MarkerState::kUnresolved;
  a_.map.marker(12).T_w_m.reset();
  const auto report = mergeMaps(&a_, b_, {});
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_EQ(a_.map.find(3)->state, slam::MarkerState::kBanned);
  for (const slam::KeyframeId id : a_.map.viewsOf(3)) EXPECT_LT(id, 4);
  EXPECT_EQ(a_.map.find(4)->state, slam::MarkerState::kMapped);
  for (const slam::KeyframeId id : a_.map.viewsOf(4)) EXPECT_LT(id, 4);
  EXPECT_EQ(a_.map.find(12)->state, slam::MarkerState::kMapped);
  EXPECT_LT((a_.map.find(12)->T_w_m->p - wall_[12].T_w_m.p).norm(), 1e-9);
}

}  // namespace
}  // namespace waymark::tools
