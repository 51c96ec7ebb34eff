#include "slam/map/map.h"

#include <algorithm>
#include <cstdint>
#include <random>
#include <utility>

#include <gtest/gtest.h>

#include "slam/testing/scene.h"
#include "slam/testing/seen_marker.h"

namespace waymark::slam {
namespace {

using testing::seen;

// Keyframes 0, 1, 2 that see markers {1, 2}, {2, 3} and {4}.
Map smallMap() {
  Map map;
  for (const int id : {1, 2, 3, 4}) map.addMarker(id, 0.1);
  for (const auto& ids : {std::vector{2, 1}, std::vector{3, 2}, std::vector{4}}) {
    Keyframe keyframe;
    for (const int id : ids) keyframe.detections.push_back(seen(id));
    (void)map.addKeyframe(std::move(keyframe));
  }
  return map;
}

std::vector<KeyframeId> viewsOf(const Map& map, int id) {
  const auto views = map.viewsOf(id);
  return {views.begin(), views.end()};
}

// A copy costs no corners, and neither of the two notices what becomes of the other.
TEST(Map, ACopySharesWhatItsKeyframesSee) {
  Map map = smallMap();
  const Map copy = map;
  const auto cornersOf = [](const Map& of, KeyframeId id) {
    return of.keyframes().at(id).detections.data();
  };
  for (const KeyframeId id : {0, 1, 2}) EXPECT_EQ(cornersOf(map, id), cornersOf(copy, id)) << id;
  MarkerDetection other = seen(3);
  other.hamming = 2;
  map.replaceView(1, other);
  map.addView(0, seen(4));
  const KeyframeId last[] = {2};
  map.removeViews(4, last);
  EXPECT_EQ(map.keyframes().at(1).find(3)->hamming, 2);
  EXPECT_EQ(map.keyframes().at(0).detections.size(), 3U);
  EXPECT_TRUE(map.keyframes().at(2).detections.empty());
  EXPECT_EQ(copy.keyframes().at(1).find(3)->hamming, 0);
  EXPECT_EQ(copy.keyframes().at(0).detections.size(), 2U);
  EXPECT_EQ(copy.keyframes().at(2).detections.size(), 1U);
}

TEST(Map, KnowsWhoSeesWhat) {
  const Map map = smallMap();
  EXPECT_EQ(viewsOf(map, 1), (std::vector<KeyframeId>{0}));
  EXPECT_EQ(viewsOf(map, 2), (std::vector<KeyframeId>{0, 1}));
  EXPECT_TRUE(map.viewsOf(99).empty());
  EXPECT_EQ(map.neighbours(0), (std::vector<KeyframeId>{0, 1}));
  EXPECT_EQ(map.neighbours(2), (std::vector<KeyframeId>{2}));
  const KeyframeId both[] = {1, 0};
  EXPECT_EQ(map.markersSeenFrom(both), (std::vector<int>{1, 2, 3}));
  const Keyframe& first = map.keyframes().at(0);
  ASSERT_NE(first.find(2), nullptr) << "detections are sorted on the way in";
  EXPECT_EQ(first.find(2)->id, 2);
  EXPECT_EQ(first.find(3), nullptr);
}

TEST(Map, AKnownMarkerStaysAsItIs) {
  Map map;
  map.addMarker(7, 0.1);
  map.place(7, Transform{});
  EXPECT_EQ(map.addMarker(7, 0.5).size_m, 0.1);
  EXPECT_TRUE(map.find(7)->T_w_m);
  EXPECT_EQ(map.find(8), nullptr);
  map.addMarker(8, 0.1);
  EXPECT_NE(map.find(8), nullptr);
  EXPECT_EQ(map.findPosed(8), nullptr) << "known, but without a pose";
}

TEST(Map, StateAndPosesGoTogether) {
  const auto at = [](double x_m) { return Transform{Eigen::Matrix3d::Identity(), {x_m, 0, 0}}; };
  Map map = smallMap();
  const MapMarker& marker = *map.find(2);
  EXPECT_EQ(marker.state, MarkerState::kUnresolved);
  map.place(2, at(1.0), at(2.0), Matrix6d::Identity());
  EXPECT_EQ(marker.state, MarkerState::kMapped);
  EXPECT_EQ(marker.T_w_m->p, at(1.0).p);
  EXPECT_EQ(marker.other_T_w_m->p, at(2.0).p);
  EXPECT_EQ(marker.covariance, Matrix6d::Identity());
  EXPECT_TRUE(marker.isSound());
  map.place(2, *marker.other_T_w_m, std::nullopt, marker.covariance);  // of its own poses
  EXPECT_EQ(marker.T_w_m->p, at(2.0).p);
  EXPECT_FALSE(marker.other_T_w_m) << "the evidence has decided";

  map.place(2, at(1.0), at(2.0));
  map.quarantine(2);
  EXPECT_EQ(marker.state, MarkerState::kQuarantined);
  EXPECT_FALSE(marker.T_w_m || marker.other_T_w_m);
  ASSERT_EQ(marker.former_poses.size(), 1U);
  EXPECT_EQ(marker.former_poses[0].p, at(1.0).p);
  EXPECT_EQ(viewsOf(map, 2).size(), 2U) << "what was seen of it is another matter";
  map.quarantine(2);
  EXPECT_EQ(marker.former_poses.size(), 1U) << "it hung nowhere since";

  map.place(2, at(3.0));
  map.ban(2);
  EXPECT_EQ(marker.state, MarkerState::kBanned);
  EXPECT_FALSE(marker.T_w_m);
  EXPECT_EQ(marker.former_poses.size(), 1U);
  EXPECT_TRUE(marker.isSound());
}

TEST(Map, WhatSeemedToHaveMovedGetsAnotherChance) {
  const auto at = [](double x_m) { return Transform{Eigen::Matrix3d::Identity(), {x_m, 0, 0}}; };
  Map map;
  for (const int id : {1, 2, 3, 4}) map.addMarker(id, 0.1);
  map.quarantine(1);
  map.place(2, at(1.0));
  map.quarantine(2);
  map.place(2, at(1.0));
  map.ban(2);  // it was back
  map.ban(3);  // two prints of one id
  map.place(4, at(2.0));
  map.quarantine(4);
  map.place(4, at(3.0));
  map.forgetMoves();
  EXPECT_EQ(map.find(1)->state, MarkerState::kUnresolved);
  EXPECT_EQ(map.find(2)->state, MarkerState::kUnresolved);
  EXPECT_EQ(map.find(3)->state, MarkerState::kBanned);
  EXPECT_EQ(map.find(4)->T_w_m->p, at(3.0).p);
  for (const auto& [id, marker] : map.markers()) {
    EXPECT_TRUE(marker.former_poses.empty()) << id;
    EXPECT_TRUE(marker.isSound()) << id;
  }
}

TEST(Map, TakesNoMarkerThatIsNotSound) {
  Map map;
  MapMarker marker;
  marker.id = 5;
  marker.size_m = 0.1;
  marker.state = MarkerState::kMapped;
  EXPECT_FALSE(map.putMarker(marker)) << "mapped, but nowhere";
  marker.state = MarkerState::kQuarantined;
  marker.T_w_m = Transform{};
  EXPECT_FALSE(map.putMarker(marker)) << "in quarantine, with a pose in use";
  marker.T_w_m.reset();
  marker.other_T_w_m = Transform{};
  EXPECT_FALSE(map.putMarker(marker)) << "a second pose without a first";
  EXPECT_EQ(map.find(5), nullptr);
  marker.other_T_w_m.reset();
  marker.former_poses = {Transform{}};
  EXPECT_TRUE(map.putMarker(marker));
  EXPECT_EQ(map.find(5)->former_poses.size(), 1U);
  marker.state = MarkerState::kMapped;
  marker.T_w_m = Transform{};
  EXPECT_TRUE(map.putMarker(marker));
  EXPECT_NE(map.findPosed(5), nullptr) << "in place of what was known";
}

MarkerLink linkTo(int marker, double x_m = 0.0) {
  MarkerLink link;
  link.marker = marker;
  link.T_c_m.p.x() = x_m;
  return link;
}

std::vector<int> linksOf(const Map& map, KeyframeId id) {
  std::vector<int> to;
  for (const MarkerLink& link : map.keyframes().at(id).links) to.push_back(link.marker);
  return to;
}

std::vector<KeyframeId> linkedTo(const Map& map, int marker) {
  std::vector<KeyframeId> from;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const std::vector<int> to = linksOf(map, id);
    if (std::ranges::find(to, marker) != to.end()) from.push_back(id);
  }
  return from;
}

TEST(Map, LinksLiveAsLongAsBothEnds) {
  Map map = smallMap();
  for (const int id : {1, 3}) map.place(id, Transform{});
  Keyframe bridge;
  bridge.links = {linkTo(3), linkTo(1), linkTo(77)};
  const KeyframeId first = map.addKeyframe(bridge);
  EXPECT_EQ(linksOf(map, first), (std::vector<int>{1, 3})) << "there is no marker 77";
  const KeyframeId second = map.addKeyframe({});
  map.addLink(second, linkTo(3));
  map.addLink(0, linkTo(3));
  EXPECT_EQ(linkedTo(map, 3), (std::vector<KeyframeId>{0, first, second}));
  map.addLink(second, linkTo(3, 0.5));
  EXPECT_EQ(linksOf(map, second).size(), 1U) << "in place of the one before";
  EXPECT_EQ(map.keyframes().at(second).links[0].T_c_m.p.x(), 0.5);

  Map other = map;
  EXPECT_EQ(linksOf(other, second), linksOf(map, second)) << "copies have them";
  other.removeKeyframe(first);
  EXPECT_EQ(linkedTo(other, 3), (std::vector<KeyframeId>{0, second}));
  EXPECT_TRUE(linkedTo(other, 1).empty());
  EXPECT_EQ(linkedTo(map, 3).size(), 3U);
  other.quarantine(3);
  EXPECT_TRUE(linkedTo(other, 3).empty()) << "it says nothing of where the marker is now";
  EXPECT_TRUE(linksOf(other, second).empty());
  map.ban(1);
  EXPECT_EQ(linksOf(map, first), (std::vector<int>{3}));
}

TEST(Map, KeyframeIdsEverGrow) {
  Map map = smallMap();
  map.removeKeyframe(2);
  EXPECT_EQ(map.addKeyframe({}), 3) << "an id is not used again";
  Keyframe from_file;
  from_file.id = 10;
  EXPECT_EQ(map.addKeyframe(from_file), 10);
  from_file.id = 5;
  EXPECT_EQ(map.addKeyframe(from_file), 11);
}

TEST(Map, ManyPosesAreSetAtOnce) {
  Map map;
  for (int i = 0; i < 100; ++i) (void)map.addKeyframe(Keyframe{});
  for (const KeyframeId gone : {3, 50, 51}) map.removeKeyframe(gone);
  std::vector<KeyframePose> poses;
  for (const KeyframeId id : {-1, 0, 3, 4, 50, 90, 99, 200}) {
    Transform T;
    T.p.x() = 1.0 + static_cast<double>(id);
    poses.push_back({id, T});
  }
  map.setKeyframePoses(poses);
  for (const auto& [id, keyframe] : map.keyframes()) {
    const bool is_set = id == 0 || id == 4 || id == 90 || id == 99;
    EXPECT_EQ(keyframe.T_w_c.p.x(), is_set ? 1.0 + static_cast<double>(id) : 0.0) << id;
  }
}

TEST(Map, ALateViewIsLikeAnyOther) {
  Map map;
  for (const int id : {1, 2, 3}) map.addMarker(id, 0.1);
  const KeyframeId first = map.addKeyframe({-1, 0, 0, {}, {seen(1), seen(3)}});
  const KeyframeId second = map.addKeyframe({-1, 1, 1, {}, {seen(2)}});
  map.addView(first, seen(2));
  ASSERT_NE(map.keyframes().at(first).find(2), nullptr);
  EXPECT_EQ(map.keyframes().at(first).find(2)->id, 2);
  EXPECT_NE(map.keyframes().at(first).find(3), nullptr) << "still sorted";
  const auto views = map.viewsOf(2);
  EXPECT_EQ(std::vector<KeyframeId>(views.begin(), views.end()),
            (std::vector<KeyframeId>{first, second}));
  EXPECT_EQ(map.neighbours(second), (std::vector<KeyframeId>{first, second}));
}

TEST(Map, RemovalsLeaveNoTrace) {
  Map map = smallMap();
  map.removeKeyframe(1);
  EXPECT_EQ(map.keyframes().count(1), 0U);
  EXPECT_EQ(viewsOf(map, 2), (std::vector<KeyframeId>{0}));
  EXPECT_TRUE(map.viewsOf(3).empty());
  EXPECT_EQ(map.neighbours(0), (std::vector<KeyframeId>{0}));

  Map other = smallMap();
  other.removeViews(2, other.viewsOf(2));  // the very list that shrinks
  EXPECT_TRUE(other.viewsOf(2).empty());
  EXPECT_EQ(other.keyframes().at(0).find(2), nullptr);
  EXPECT_NE(other.keyframes().at(0).find(1), nullptr);
  other.removeViews(4, other.viewsOf(4));
  EXPECT_EQ(other.keyframes().count(2), 1U) << "a keyframe that sees nothing stays";
  EXPECT_EQ(other.neighbours(2), (std::vector<KeyframeId>{2}));
}

// Whoever copies it over several frames is told by that.
TEST(Map, CountsItsChanges) {
  Map map = smallMap();
  std::uint64_t before = map.changes();
  const auto hasChanged = [&] { return std::exchange(before, map.changes()) != map.changes(); };
  (void)map.addMarker(1, 0.1);
  EXPECT_FALSE(hasChanged()) << "known already";
  (void)map.addMarker(9, 0.1);
  EXPECT_TRUE(hasChanged());
  map.place(1, Transform{});
  EXPECT_TRUE(hasChanged());
  map.setWorldCovariance(1, Matrix6d::Identity());
  EXPECT_TRUE(hasChanged());
  map.quarantine(1);
  EXPECT_TRUE(hasChanged());
  map.setElsewhere(1, true);
  EXPECT_TRUE(hasChanged());
  map.ban(1);
  EXPECT_TRUE(hasChanged());
  map.setKeyframePose(0, Transform{});
  EXPECT_TRUE(hasChanged());
  map.setKeyframeTwist(0, Vector6d::Zero());
  EXPECT_TRUE(hasChanged());
  map.addView(2, seen(1));
  EXPECT_TRUE(hasChanged());
  map.replaceView(2, seen(1));
  EXPECT_TRUE(hasChanged());
  map.removeViews(4, map.viewsOf(4));
  EXPECT_TRUE(hasChanged());
  map.moveWorld(Transform{});
  EXPECT_TRUE(hasChanged());
  map.removeKeyframe(0);
  EXPECT_TRUE(hasChanged());
  (void)map.addKeyframe({});
  EXPECT_TRUE(hasChanged());
}

TEST(Map, IsLetGoOfBitByBit) {
  Map map = smallMap();
  int times = 1;
  while (!map.letGo(2)) ++times;
  EXPECT_EQ(times, 6) << "3 keyframes, 4 markers, and the views of each";
  EXPECT_TRUE(map.keyframes().empty());
  EXPECT_TRUE(map.markers().empty());
}

TEST(Map, MoveWorldMovesEverything) {
  std::mt19937 rng(1);
  const auto anyPose = [&] { return testing::disturbed(Transform{}, 0.7, &rng); };
  Map map = smallMap();
  for (const auto& [id, keyframe] : map.keyframes()) map.setKeyframePose(id, anyPose());
  for (int i = 0; i < 2; ++i) {
    map.place(2, anyPose());
    map.quarantine(2);
  }
  // The covariance as the spread of six steps from the pose.
  std::vector<Vector6d> steps;
  Matrix6d covariance = Matrix6d::Zero();
  for (int i = 0; i < 6; ++i) {
    steps.push_back(Transform{}.localCoordinates(testing::disturbed(Transform{}, 0.05, &rng)));
    covariance += steps.back() * steps.back().transpose();
  }
  map.place(2, anyPose(), anyPose(), covariance);
  map.addLink(2, {2, anyPose(), Matrix6d::Identity()});
  const Map before = map;
  const Transform T_v_w = anyPose();
  map.moveWorld(T_v_w);

  const auto expectMoved = [&](const Transform& moved, const Transform& was) {
    EXPECT_LT((moved.p - (T_v_w * was).p).norm(), 1e-12);
    EXPECT_LT((moved.R - (T_v_w * was).R).norm(), 1e-12);
  };
  const MapMarker& was = *before.find(2);
  const MapMarker& marker = *map.find(2);
  expectMoved(*marker.T_w_m, *was.T_w_m);
  expectMoved(*marker.other_T_w_m, *was.other_T_w_m);
  ASSERT_EQ(marker.former_poses.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) expectMoved(marker.former_poses[i], was.former_poses[i]);
  for (const auto& [id, keyframe] : before.keyframes()) {
    expectMoved(map.keyframes().at(id).T_w_c, keyframe.T_w_c);
  }
  Matrix6d spread = Matrix6d::Zero();
  for (const Vector6d& step : steps) {
    const Vector6d moved = marker.T_w_m->localCoordinates(T_v_w * was.T_w_m->retract(step));
    spread += moved * moved.transpose();
  }
  EXPECT_LT((marker.covariance - spread).norm(), 1e-9 * spread.norm());
  EXPECT_FALSE(map.find(1)->T_w_m) << "what has no pose gets none";
  const MarkerLink& link = map.keyframes().at(2).links.at(0);
  EXPECT_EQ(link.T_c_m.p, before.keyframes().at(2).links.at(0).T_c_m.p) << "is relative";
  EXPECT_EQ(link.T_c_m.R, before.keyframes().at(2).links.at(0).T_c_m.R);
  EXPECT_EQ(link.covariance, Matrix6d::Identity());
}

}  // namespace
}  // namespace waymark::slam
