#include "slam/mapping/mapper.h"

#include <memory>
#include <random>

#include <gtest/gtest.h>

#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.15;

// A wall of tilted markers 2 m away, and views of it. The world of the tests is not the map's:
// `expected` gives the truth in the world of the first view.
class MapperTest : public ::testing::Test {
 protected:
  MapperTest() { options_.size_m = kSize; }

  static Transform view(int i) {
    return testing::lookAt({0.15 * i - 0.4, 1.0 + 0.1 * (i % 3), 0.15 * (i % 2)},
                           {0.05 * i - 0.1, 3.0, 0.0});
  }

  // View i as a keyframe: in the map's world at T_v_w * view, or where `T_w_c` says.
  Keyframe frame(int i, const Transform& T_v_w = view(0).inverse(), double sigma_px = 0.05) {
    Keyframe keyframe;
    keyframe.T_w_c = T_v_w * view(i);
    keyframe.detections = testing::observeAll(camera_, view(i), markers_, kSize, sigma_px, &rng_);
    return keyframe;
  }

  // A map begun from view 0.
  std::unique_ptr<Mapper> begun(Map* map, const MapperOptions& mapping = {}) {
    auto mapper = std::make_unique<Mapper>(options_, camera_.focalLength(), mapping);
    Start start{{frame(0)}, {}};
    start.markers = initializeFromOneFrame(start.keyframes[0].detections, options_,
                                           camera_.focalLength(), 3.0, {});
    EXPECT_GE(start.markers.size(), 2U);
    (void)mapper->begin(start, map, &counters_);
    return mapper;
  }

  // With the local optimization done. The keyframe's pose then; empty when it is none.
  std::optional<Transform> update(Mapper* mapper, const Keyframe& keyframe, bool force, Map* map) {
    if (!force && !mapper->wants(keyframe.detections, keyframe.T_w_c, *map)) return std::nullopt;
    mapper->insert(keyframe, map, &counters_);
    while (!mapper->idle()) {
      (void)mapper->work(1e9, *map);
      (void)mapper->collect(map, &counters_);
    }
    return map->keyframes().rbegin()->second.T_w_c;
  }

  // As the marker watch does.
  static void quarantine(int id, Map* map) {
    map->addMarker(id, kSize);
    map->quarantine(id);
    map->removeViews(id, map->viewsOf(id));
  }

  [[nodiscard]] const Transform& truth(int id) const {
    return markers_[static_cast<std::size_t>(id)].T_w_m;
  }

  void expectTruth(const Map& map, const Transform& T_v_w, double worst_m) {
    int posed = 0;
    for (const auto& [id, marker] : map.markers()) {
      if (!marker.T_w_m) continue;
      ++posed;
      EXPECT_LT((marker.T_w_m->p - (T_v_w * truth(id)).p).norm(), worst_m) << "marker " << id;
    }
    EXPECT_GE(posed, 4);
  }

  std::mt19937 rng_{51};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(2, 4, 0.35, &rng_);
  MarkerOptions options_;
  Counters counters_;
};

TEST_F(MapperTest, GrowsTheMapAndKeepsItTrue) {
  Map map;
  const auto mapper = begun(&map);
  for (int i = 1; i < 10; ++i) {
    const Keyframe keyframe = frame(i);
    const auto moved = update(mapper.get(), keyframe, false, &map);
    if (!moved) continue;
    EXPECT_LT((moved->p - keyframe.T_w_c.p).norm(), 0.02);
    EXPECT_EQ(moved->p, map.keyframes().rbegin()->second.T_w_c.p);
  }
  EXPECT_EQ(map.markers().size(), markers_.size());
  EXPECT_GE(map.keyframes().size(), 5U);
  EXPECT_EQ(counters_.keyframes_added, map.keyframes().size());
  expectTruth(map, view(0).inverse(), 0.02);
  EXPECT_LT(mapper->residualSigma(), 1.5) << "the corners' covariances say it all";
}

// Keyframes come while the local optimization of an earlier one is under way.
TEST_F(MapperTest, OptimizesInSlicesWhileTheMapGrows) {
  Map map;
  const auto mapper = begun(&map);
  int collected = 0;
  for (int i = 1; i < 10; ++i) {
    mapper->insert(frame(i), &map, &counters_);
    for (int slice = 0; slice < 3; ++slice) {
      (void)mapper->work(20.0, map);
      if (mapper->collect(&map, &counters_)) ++collected;
    }
  }
  EXPECT_GT(collected, 0);
  EXPECT_LT(collected, 9) << "too little was given to optimize after each";
  EXPECT_FALSE(mapper->idle());
  while (!mapper->idle()) {
    (void)mapper->work(20.0, map);
    (void)mapper->collect(&map, &counters_);
  }
  expectTruth(map, view(0).inverse(), 0.02);
}

// Before any optimization has come to them.
TEST_F(MapperTest, NewMarkersFollowTheirFirstViews) {
  const auto errorWith = [&](int young_views) {
    double squared = 0.0;
    for (unsigned seed = 0; seed < 20; ++seed) {
      rng_.seed(seed);
      Map map;
      const auto mapper = begun(&map, {.young_views = young_views});
      for (int i = 1; i < 6; ++i)
        mapper->insert(frame(i, view(0).inverse(), 0.2), &map, &counters_);
      for (const auto& [id, marker] : map.markers()) {
        if (!marker.T_w_m) continue;
        squared += (marker.T_w_m->p - (view(0).inverse() * truth(id)).p).squaredNorm();
      }
    }
    return std::sqrt(squared);
  };
  EXPECT_LT(errorWith(8), 0.7 * errorWith(0));
}

TEST_F(MapperTest, NothingNewIsNoKeyframeUnlessForced) {
  Map map;
  const auto mapper = begun(&map);
  for (int i = 1; i < 10; ++i) (void)update(mapper.get(), frame(i), false, &map);
  const std::size_t before = map.keyframes().size();
  const Keyframe again = frame(4);
  EXPECT_FALSE(update(mapper.get(), again, false, &map));
  EXPECT_EQ(map.keyframes().size(), before);
  EXPECT_TRUE(update(mapper.get(), again, true, &map));
}

TEST_F(MapperTest, TheOriginMarkerIsTheWorld) {
  options_.origin_marker = 1;
  Map map;
  const auto mapper = begun(&map);
  ASSERT_TRUE(map.findPosed(1)) << "the first view has it";
  const Transform T_o_w = truth(1).inverse();
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(map.find(1)->T_w_m->p, Eigen::Vector3d::Zero());
    EXPECT_EQ(map.find(1)->T_w_m->R, Eigen::Matrix3d::Identity());
    (void)update(mapper.get(), frame(i, T_o_w), true, &map);
  }
  expectTruth(map, T_o_w, 0.02);
}

// Until the origin marker is seen, the first keyframe is the world; then everything moves over.
TEST_F(MapperTest, TheOriginMarkerMayComeLater) {
  options_.origin_marker = 7;
  const testing::SyntheticMarker late = markers_[7];
  markers_.pop_back();
  Map map;
  const auto mapper = begun(&map);
  (void)update(mapper.get(), frame(2), true, &map);
  expectTruth(map, view(0).inverse(), 0.03);
  markers_.push_back(late);
  std::optional<Transform> moved;
  for (int i = 3; i < 10 && map.findPosed(7) == nullptr; ++i) {
    moved = update(mapper.get(), frame(i), true, &map);
    if (map.findPosed(7) == nullptr) continue;
    ASSERT_TRUE(moved);
    EXPECT_LT((moved->p - (truth(7).inverse() * view(i)).p).norm(), 0.05)
        << "the pose is given in the new world";
  }
  ASSERT_NE(map.findPosed(7), nullptr);
  EXPECT_EQ(map.find(7)->T_w_m->p, Eigen::Vector3d::Zero());
  expectTruth(map, truth(7).inverse(), 0.05);
}

TEST_F(MapperTest, AnchorsFixTheWorld) {
  // Surveyed in a world of their own, which is neither the map's nor the tests'.
  const Transform T_s_w = {expSo3({0.3, -0.2, 0.5}), {5.0, -2.0, 1.0}};
  for (const int id : {1, 2, 6}) options_.anchors.push_back({id, T_s_w * truth(id)});
  Map map;
  const auto mapper = begun(&map);
  ASSERT_TRUE(map.findPosed(1));
  for (int i = 1; i < 8; ++i) (void)update(mapper.get(), frame(i, T_s_w), true, &map);
  expectTruth(map, T_s_w, 0.01);
}

// The same by centres alone, the first keyframe's world until there are enough of them.
TEST_F(MapperTest, SurveyedPositionsFixTheWorld) {
  const Transform T_s_w = {expSo3({0.3, -0.2, 0.5}), {5.0, -2.0, 1.0}};
  for (const int id : {0, 2, 5, 7}) {
    options_.constraints.positions.push_back({.id = id, .p_w = (T_s_w * truth(id)).p});
  }
  Map map;
  const auto mapper = begun(&map);
  for (int i = 1; i < 10; ++i) (void)update(mapper.get(), frame(i, T_s_w), true, &map);
  expectTruth(map, T_s_w, 0.02);
  EXPECT_EQ(counters_.gated_constraints, 0U);
}

// A marker that hangs half a metre from where a tape has it is counted, and stays where it is.
TEST_F(MapperTest, WhatViewsContradictIsCounted) {
  options_.constraints.distances = {
      {.id_a = 0, .id_b = 1, .distance_m = 0.5 + (truth(0).p - truth(1).p).norm()}};
  Map map;
  const auto mapper = begun(&map);
  for (int i = 1; i < 10; ++i) (void)update(mapper.get(), frame(i), true, &map);
  EXPECT_GT(counters_.gated_constraints, 0U);
  expectTruth(map, view(0).inverse(), 0.02);
}

// An early choice that more views overturn: the marker was posed by its other solution.
TEST_F(MapperTest, AFlippedHypothesisIsMended) {
  Map map;
  const auto mapper = begun(&map);
  (void)update(mapper.get(), frame(1), true, &map);
  const Transform T_v_w = view(0).inverse();
  // The wrong solution of marker 5 as the first view has it.
  const MarkerDetection* seen = map.keyframes().at(0).find(5);
  ASSERT_NE(seen, nullptr);
  const auto square = estimateSquarePose(*seen, kSize, camera_.focalLength());
  ASSERT_TRUE(square);
  map.place(5, square->T_c_m[1], square->T_c_m[0]);
  const double flip = rotationDistance(square->T_c_m[1].R, (T_v_w * truth(5)).R);
  ASSERT_GT(flip, 0.2);
  for (int i = 2; i < 10; ++i) (void)update(mapper.get(), frame(i), true, &map);
  ASSERT_TRUE(map.findPosed(5));
  EXPECT_LT(rotationDistance(map.find(5)->T_w_m->R, (T_v_w * truth(5)).R), 0.05);
  EXPECT_EQ(counters_.flipped_markers, 1U);
  expectTruth(map, T_v_w, 0.02);
}

TEST_F(MapperTest, ASecondLookWaitsForItsViews) {
  for (const int needed : {2, 4}) {
    Map map;
    MapperOptions mapping;
    mapping.second_look_views = needed;
    const auto mapper = begun(&map, mapping);
    const auto square =
        estimateSquarePose(*map.keyframes().at(0).find(5), kSize, camera_.focalLength());
    ASSERT_TRUE(square);
    map.place(5, square->T_c_m[1], square->T_c_m[0]);
    counters_ = {};
    for (int i = 1; i < needed; ++i) {
      EXPECT_EQ(counters_.flipped_markers, 0U) << "with " << i << " of " << needed << " views";
      (void)update(mapper.get(), frame(i), true, &map);
    }
    EXPECT_EQ(counters_.flipped_markers, 1U) << "with " << needed << " views";
  }
}

// It has been wrong before: one view, clear as it may be, does not convince.
TEST_F(MapperTest, AQuarantinedMarkerNeedsSeveralViews) {
  Map map;
  const auto mapper = begun(&map);
  quarantine(5, &map);
  const int needed = MarkerResolverOptions{}.min_views;
  for (int i = 1; i < needed; ++i) {
    const Keyframe keyframe = frame(i);
    ASSERT_NE(keyframe.find(5), nullptr);
    (void)update(mapper.get(), keyframe, true, &map);
    EXPECT_FALSE(map.find(5)->T_w_m) << "view " << i;
    EXPECT_EQ(map.find(5)->state, MarkerState::kQuarantined);
  }
  for (int i = needed; i < needed + 3; ++i) {
    (void)update(mapper.get(), frame(i), true, &map);
  }
  ASSERT_TRUE(map.findPosed(5));
  EXPECT_EQ(map.find(5)->state, MarkerState::kMapped);
  EXPECT_LT((map.find(5)->T_w_m->p - (view(0).inverse() * truth(5)).p).norm(), 0.02);
}

// At the end of a recording: one view among many is of another place, and goes.
TEST_F(MapperTest, MarkersWithoutAPoseAreResolvedInTheEnd) {
  Map map;
  const auto mapper = begun(&map);
  for (int i = 1; i < 8; ++i) (void)update(mapper.get(), frame(i), true, &map);
  map.quarantine(5);
  const KeyframeId seen_by = map.viewsOf(5)[2];
  testing::displaceView(seen_by, 5, 20.0 / camera_.focalLength(), &map);
  const std::size_t views = map.viewsOf(5).size();
  mapper->resolveAll(&map);
  ASSERT_TRUE(map.findPosed(5));
  EXPECT_LT((map.find(5)->T_w_m->p - (view(0).inverse() * truth(5)).p).norm(), 0.02);
  EXPECT_EQ(map.viewsOf(5).size(), views - 1);
  EXPECT_EQ(map.keyframes().at(seen_by).find(5), nullptr);
}

// A marker without a pose that was carried about: the old views go one by one, until the rest
// agree.
TEST_F(MapperTest, ViewsFromBeforeAMoveAreLetGo) {
  Map map;
  const auto mapper = begun(&map);
  quarantine(5, &map);
  for (int i = 1; i < 3; ++i) (void)update(mapper.get(), frame(i), true, &map);
  markers_[5].T_w_m.p += Eigen::Vector3d(0.12, 0.0, 0.1);
  for (int i = 3; i < 10; ++i) {
    (void)update(mapper.get(), frame(i), true, &map);
    if (const MapMarker* found = map.findPosed(5)) {
      EXPECT_LT((found->T_w_m->p - (view(0).inverse() * truth(5)).p).norm(), 0.03) << "view " << i;
    }
  }
  EXPECT_TRUE(map.findPosed(5));
  expectTruth(map, view(0).inverse(), 0.03);
}

// Far and frontal: ambiguous in each view, and so without a pose until several views decide.
TEST_F(MapperTest, AnAmbiguousMarkerWaitsForSeveralViews) {
  markers_.push_back({8, testing::markerFacing({0.0, 5.5, 0.45}, {0.3, 0.0, 0.3})});
  Map map;
  const auto mapper = begun(&map);
  const auto ambiguous = [&](const Keyframe& keyframe) {
    const MarkerDetection* seen = keyframe.find(8);
    if (seen == nullptr) return false;
    const auto square = estimateSquarePose(*seen, kSize, camera_.focalLength());
    return square && !square->unambiguous(3.0);
  };
  ASSERT_TRUE(ambiguous(map.keyframes().at(0)));
  EXPECT_EQ(map.find(8)->state, MarkerState::kUnresolved);
  EXPECT_FALSE(map.find(8)->T_w_m);
  for (int i = 1; i < 14 && map.findPosed(8) == nullptr; ++i) {
    const Keyframe keyframe = frame(i);
    ASSERT_TRUE(keyframe.find(8) == nullptr || ambiguous(keyframe));
    (void)update(mapper.get(), keyframe, true, &map);
  }
  ASSERT_TRUE(map.findPosed(8));
  EXPECT_GE(map.viewsOf(8).size(), 3U);
  EXPECT_LT(rotationDistance(map.find(8)->T_w_m->R, (view(0).inverse() * truth(8)).R), 0.15);
}

}  // namespace
}  // namespace waymark::slam
