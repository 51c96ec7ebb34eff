#include "slam/loop_closure/loop_closer.h"

#include <algorithm>
#include <random>

#include <gtest/gtest.h>

#include "slam/loop_closure/loop_adoption.h"
#include "slam/loop_closure/testing_open_room.h"
#include "slam/optimization/map_optimizer.h"
#include "slam/testing/scene.h"
#include "slam/testing/whole_map_fit.h"

namespace waymark::slam {
namespace {

using LoopCloserTest = testing::OpenRoom;

TEST_F(LoopCloserTest, TakesTheDriftOutOfABentMap) {
  Map map = openMap(24, 0.05);
  testing::bend(drift_, &map);
  const Map before = map;
  ASSERT_GT(keyframeError(map), 0.2);
  const LoopFrame loop = loopFrame(map, see(testing::roomView(345.0 * kDegree), 0.05));
  const auto outcome = close(map, loop);
  ASSERT_TRUE(std::holds_alternative<ClosedLoop>(outcome));
  const Map closed = closedMap(map, outcome);
  EXPECT_LT(keyframeError(closed), 0.05 * keyframeError(map));
  EXPECT_LT(markerError(closed), 0.05 * markerError(map));
  EXPECT_LT(
      (closed.keyframes().rbegin()->second.T_w_c.p - testing::roomView(345.0 * kDegree).p).norm(),
      0.01);
  // The world stays where it is, and the map given is not touched.
  EXPECT_LT((closed.keyframes().at(0).T_w_c.p - views_[0].p).norm(), 1e-9);
  EXPECT_LT(rotationDistance(closed.keyframes().at(0).T_w_c.R, views_[0].R), 1e-7);
  EXPECT_EQ(map.keyframes().size() + 1, closed.keyframes().size());
  EXPECT_EQ(keyframeError(map), keyframeError(before));
}

// While the loop is being closed, the map goes on growing at its drifted end.
TEST_F(LoopCloserTest, WhatCameMeanwhileMovesWithTheClosingFrame) {
  Map map = openMap(24, 0.05);
  testing::bend(drift_, &map);
  const LoopFrame loop = loopFrame(map, see(testing::roomView(345.0 * kDegree), 0.05));
  for (const MarkerDetection& seen : Keyframe(map.keyframes().at(8)).detections) {
    const KeyframeId old[] = {8};
    map.removeViews(seen.id, old);
  }
  SlicedTask<LoopOutcome> task(
      [&](Budget* a) { return closeLoop(map, loop, options_, LoopOptions{}, a); });
  ASSERT_FALSE(task.advance(100.0));
  const Transform T_closing_late{expSo3({0.0, 0.05, 0.0}), {0.1, 0.0, 0.2}};
  map.addMarker(99, kSize);
  MarkerDetection seen;
  seen.id = 99;
  const KeyframeId late = map.addKeyframe({-1, 0, 0, loop.frame.T_w_c * T_closing_late, {{seen}}});
  map.place(99, loop.frame.T_w_c * T_closing_late);
  map.removeKeyframe(20);
  // An old one whose markers are all in quarantine: nobody knows where it belongs by now.
  const Transform T_old = map.keyframes().at(8).T_w_c;
  int slices = 2;
  while (!task.advance(100.0)) ++slices;
  EXPECT_GT(slices, 5);
  const LoopOutcome outcome = task.take();
  ASSERT_TRUE(std::holds_alternative<ClosedLoop>(outcome));
  const auto adopted = adopt(std::get<ClosedLoop>(outcome), {}, &map);
  ASSERT_TRUE(adopted);
  const Transform expected = map.keyframes().at(adopted->closing).T_w_c * T_closing_late;
  EXPECT_LT((map.keyframes().at(late).T_w_c.p - expected.p).norm(), 1e-9);
  EXPECT_LT((map.find(99)->T_w_m->p - expected.p).norm(), 1e-9);
  EXPECT_EQ(map.keyframes().at(8).T_w_c.p, T_old.p);
  EXPECT_LT(markerError(map), 0.02);
  EXPECT_FALSE(adopt(std::get<ClosedLoop>(outcome), {}, &map)) << "it has been";
}

// The frame that closes the loop was worth a keyframe by itself, without the loop's markers.
TEST_F(LoopCloserTest, TheClosingFrameIsNoSecondKeyframeWhereItIsOneAlready) {
  for (const bool before_closing : {true, false}) {
    Map map = openMap(24, 0.05);
    testing::bend(drift_, &map);
    LoopFrame loop = loopFrame(map, see(testing::roomView(345.0 * kDegree), 0.05));
    loop.frame.sequence = 34;
    loop.frame.monotonic_ns = 1'000;
    Keyframe itself = loop.frame;
    itself.detections.change([&](auto* detections) {
      std::erase_if(*detections, [&](const MarkerDetection& d) {
        return std::ranges::find(loop.loop_markers, d.id) != loop.loop_markers.end();
      });
    });
    ASSERT_LT(itself.detections.size(), loop.frame.detections.size());
    KeyframeId known = before_closing ? map.addKeyframe(itself) : -1;
    const LoopOutcome outcome = close(map, loop);
    ASSERT_TRUE(std::holds_alternative<ClosedLoop>(outcome));
    if (!before_closing) known = map.addKeyframe(itself);
    Keyframe later = loop.frame;
    later.sequence = 35;
    (void)map.addKeyframe(later);
    const std::size_t keyframes = map.keyframes().size();
    const auto adopted = adopt(std::get<ClosedLoop>(outcome), {}, &map);
    ASSERT_TRUE(adopted);
    EXPECT_EQ(adopted->closing, known);
    EXPECT_FALSE(adopted->added);
    EXPECT_EQ(map.keyframes().size(), keyframes);
    const Eigen::Vector3d error =
        map.keyframes().at(known).T_w_c.p - testing::roomView(345.0 * kDegree).p;
    EXPECT_LT(error.norm(), 0.01);
    for (const MarkerDetection& seen : loop.frame.detections) {
      ASSERT_NE(map.keyframes().at(known).find(seen.id), nullptr);
      EXPECT_EQ(std::ranges::count(map.viewsOf(seen.id), known), 1) << "and once";
    }
  }
}

// Frames without times and sequences: another one has seen other corners.
TEST_F(LoopCloserTest, AnotherFrameOfTheSameTimeIsNotTheClosingFrame) {
  Map map = openMap(24, 0.05);
  testing::bend(drift_, &map);
  const LoopFrame loop = loopFrame(map, see(testing::roomView(345.0 * kDegree), 0.05));
  const LoopOutcome outcome = close(map, loop);
  Keyframe other = loop.frame;
  other.detections = see(testing::roomView(345.0 * kDegree), 0.05);
  const KeyframeId id = map.addKeyframe(other);
  const auto adopted = adopt(std::get<ClosedLoop>(outcome), {}, &map);
  ASSERT_TRUE(adopted);
  EXPECT_TRUE(adopted->added);
  EXPECT_NE(adopted->closing, id);
}

// What came since hangs between what moved much and what moved little, and follows both.
TEST_F(LoopCloserTest, WhatCameMeanwhileMovesAsWhatItSees) {
  Map map = openMap(24, 0.05);
  const KeyframeId newest = map.keyframes().rbegin()->first;
  const auto& seen = map.keyframes().at(newest).detections;
  ASSERT_GE(seen.size(), 2U);
  ClosedLoop loop;
  loop.newest = newest;
  loop.closing = map.keyframes().at(newest);
  ++loop.closing.sequence;  // another frame
  loop.T_w_tracked = loop.closing.T_w_c;
  loop.closing.T_w_c.p.x() += 5.0;
  loop.correction.epoch = map.epoch();
  const auto move = [&](std::size_t i, double by_m) {
    Transform T_w_m = *map.find(seen[i].id)->T_w_m;
    T_w_m.p.z() += by_m;
    loop.correction.markers.push_back({{seen[i].id, 0}, T_w_m, Matrix6d::Zero()});
  };
  move(0, 0.02);
  move(1, 0.04);
  const Transform T_w_late = map.keyframes().at(newest).T_w_c;
  Keyframe late = map.keyframes().at(newest);
  late.id = -1;
  late.detections = {{seen[0], seen[1]}};
  const KeyframeId with_both = map.addKeyframe(late);
  late.detections = {{seen[1]}};
  const KeyframeId with_one = map.addKeyframe(late);
  const auto adopted = adopt(loop, {}, &map);
  ASSERT_TRUE(adopted);
  EXPECT_NEAR(map.keyframes().at(with_both).T_w_c.p.z() - T_w_late.p.z(), 0.03, 1e-12);
  EXPECT_NEAR(map.keyframes().at(with_one).T_w_c.p.z() - T_w_late.p.z(), 0.04, 1e-12);
  EXPECT_NEAR(adopted->T_new_old.p.z(), 0.04, 1e-12) << "the newest says where the camera is";
  EXPECT_EQ(map.keyframes().at(newest).T_w_c.p, T_w_late.p) << "it was in no part of it";
}

// Half of the map is off by a centimetre from where its last views have it.
TEST_F(LoopCloserTest, RelaxesARegionAndLeavesTheRest) {
  Map map = openMap(24, 0.05);
  (void)optimizeGlobally(&map, options_, {.max_iterations = 50});
  const Map before = map;
  LoopFrame frame;
  frame.reference = map.keyframes().rbegin()->first;
  frame.frame = map.keyframes().at(frame.reference);
  frame.frame.id = -1;
  const int misfit = frame.frame.detections[0].id;
  Transform T_w_m = *map.find(misfit)->T_w_m;
  T_w_m.p.z() += 0.01;
  map.place(misfit, T_w_m);
  frame.loop_markers = {misfit};
  LoopOptions options;
  options.region_keyframes = 8;
  const auto outcome =
      runToCompletion([&](Budget* a) { return relaxRegion(map, frame, options_, options, a); });
  ASSERT_TRUE(std::holds_alternative<ClosedLoop>(outcome));
  ASSERT_TRUE(adopt(std::get<ClosedLoop>(outcome), {}, &map));
  EXPECT_LT((map.find(misfit)->T_w_m->p - before.find(misfit)->T_w_m->p).norm(), 0.001);
  int moved = 0;
  for (const auto& [id, keyframe] : before.keyframes()) {
    if (map.keyframes().at(id).T_w_c.p != keyframe.T_w_c.p) ++moved;
  }
  EXPECT_GT(moved, 0);
  EXPECT_LE(moved, 8);
}

// The drift that noise itself makes, in a map that is as good as an open chain can be. The closing
// frame's pose is then as good as a pose from the markers at the loop's beginning is.
TEST_F(LoopCloserTest, TakesOutTheDriftThatNoiseMakes) {
  double drift = 0.0;
  double beginning = 0.0;
  double after = 0.0;
  constexpr int kTrials = 10;
  for (int trial = 0; trial < kTrials; ++trial) {
    Map map = openMap(14, 0.3);
    (void)optimizeGlobally(&map, options_, {.max_iterations = 50});
    const Transform view = testing::roomView(347.0 * kDegree);
    const LoopFrame loop = loopFrame(map, see(view, 0.3));
    const auto outcome = close(map, loop);
    const auto* closed = std::get_if<ClosedLoop>(&outcome);
    ASSERT_TRUE(closed != nullptr) << "trial " << trial;
    drift += (loop.frame.T_w_c.p - view.p).norm() / kTrials;
    beginning += (loop.expected[0].p - view.p).norm() / kTrials;
    after += (closed->closing.T_w_c.p - view.p).norm() / kTrials;
    EXPECT_LT(testing::wholeMapFit(closedMap(map, outcome)).residual_sigma, 1.2)
        << "all views fit within their noise";
  }
  EXPECT_GT(drift, 0.2);
  EXPECT_LT(after, 1.5 * beginning) << drift << " m before";
  EXPECT_LT(after, 0.5 * drift);
}

// One ambiguous marker is all there is at the other end: two candidates, of which one fits.
TEST_F(LoopCloserTest, OneAmbiguousMarkerClosesTheLoop) {
  Map map = openMap(14, 0.1);
  (void)optimizeGlobally(&map, options_, {.max_iterations = 50});
  const Transform view = testing::roomView(347.0 * kDegree);
  LoopFrame loop;
  for (int trial = 0; trial < 200 && loop.expected.size() < 2; ++trial) {
    loop = loopFrame(map, see(view, 0.4));
    ASSERT_EQ(loop.loop_markers, (std::vector<int>{0}));
  }
  ASSERT_EQ(loop.expected.size(), 2U) << "the marker is not ambiguous";
  for (int order = 0; order < 2; ++order) {  // whichever comes first
    const auto outcome = close(map, loop);
    ASSERT_TRUE(std::holds_alternative<ClosedLoop>(outcome))
        << "refusal " << static_cast<int>(std::get<LoopRejection>(outcome));
    const Map closed = closedMap(map, outcome);
    const Transform& T_w_c = closed.keyframes().rbegin()->second.T_w_c;
    EXPECT_LT((T_w_c.p - view.p).norm(), (loop.frame.T_w_c.p - view.p).norm());
    // Far from the wrong candidate's map: the two differ by several tenths of a radian.
    const double apart = rotationDistance(loop.expected[0].R, loop.expected[1].R);
    EXPECT_GT(apart, 0.2);
    EXPECT_LT(rotationDistance(T_w_c.R, view.R), 0.4 * apart);
    std::swap(loop.expected[0], loop.expected[1]);
  }
}

// Two candidates that the optimization leads to one and the same map do not contradict each other.
TEST_F(LoopCloserTest, TwoWaysToTheSameMapAreNotAmbiguous) {
  Map map = openMap(24, 0.05);
  (void)optimizeGlobally(&map, options_, {.max_iterations = 50});
  LoopFrame loop = loopFrame(map, see(testing::roomView(345.0 * kDegree), 0.05));
  loop.expected.push_back(testing::disturbed(loop.expected[0], 0.05, &rng_));
  EXPECT_TRUE(std::holds_alternative<ClosedLoop>(close(map, loop)));
}

// The map has next to no drift; the "loop" is a marker that was carried 20 cm. To believe it would
// bend a good map.
TEST_F(LoopCloserTest, RejectsAMarkerThatMoved) {
  Map map = openMap(24, 0.05);
  (void)optimizeGlobally(&map, options_, {.max_iterations = 50});
  ASSERT_LT(keyframeError(map), 0.05);
  const Transform view = testing::roomView(345.0 * kDegree);
  const auto honest = close(map, loopFrame(map, see(view, 0.05)));
  EXPECT_TRUE(std::holds_alternative<ClosedLoop>(honest));
  markers_[0].T_w_m.p += Eigen::Vector3d(-0.05, -0.12, 0.15);
  const LoopFrame loop = loopFrame(map, see(view, 0.05));
  ASSERT_EQ(loop.loop_markers, (std::vector<int>{0}));
  const auto moved = close(map, loop);
  ASSERT_TRUE(std::holds_alternative<LoopRejection>(moved));
  EXPECT_EQ(std::get<LoopRejection>(moved), LoopRejection::kContradicted);
}

// What the closing frame shows fits nothing; but where it is says how the map is bent. It comes out
// much straighter, without that frame.
TEST_F(LoopCloserTest, UnbendsTheMapThoughItsClosingFrameDoesNotFit) {
  Map map = openMap(24, 0.05);
  testing::bend(drift_, &map);
  LoopFrame loop = loopFrame(map, see(testing::roomView(345.0 * kDegree), 0.05));
  loop.frame.detections.change([](auto* detections) {
    for (MarkerDetection& detection : *detections) {
      detection.normalized[0].x() += 0.05;
      detection.normalized[2].x() += 0.05;
    }
  });
  const auto outcome = close(map, loop);
  const auto* relaxed = std::get_if<RelaxedMap>(&outcome);
  ASSERT_NE(relaxed, nullptr);
  const double before = keyframeError(map);
  EXPECT_TRUE(adopt(*relaxed, {}, &map));
  EXPECT_EQ(map.keyframes().size(), views_.size());
  EXPECT_LT(keyframeError(map), 0.3 * before);
}

// A second print of the first marker hangs on the opposite wall: the map would fold.
TEST_F(LoopCloserTest, RejectsASecondPrint) {
  Map map = openMap(24, 0.05);
  markers_[0].T_w_m = testing::markerFacing({-2.4, 0.9, 0.3}, {0.0, 0.6, 0.1});
  // Half way round; the keyframes after it are not there yet.
  for (KeyframeId id = 17; id < 34; ++id) map.removeKeyframe(id);
  const LoopFrame loop = loopFrame(map, see(testing::roomView(160.0 * kDegree), 0.05));
  ASSERT_EQ(loop.loop_markers, (std::vector<int>{0}));
  const auto outcome = close(map, loop);
  ASSERT_TRUE(std::holds_alternative<LoopRejection>(outcome));
}

// Keyframes that see nothing any more (their markers are in quarantine) are no hindrance, and the
// second hypothesis of a marker moves along with the first.
TEST_F(LoopCloserTest, RejectsWhatSaysNothing) {
  const Map map = openMap(24, 0.05);
  LoopFrame loop = loopFrame(map, see(testing::roomView(345.0 * kDegree), 0.05));
  loop.expected.clear();
  const auto outcome = close(map, loop);
  ASSERT_TRUE(std::holds_alternative<LoopRejection>(outcome));
  EXPECT_EQ(std::get<LoopRejection>(outcome), LoopRejection::kNoEvidence);
}

TEST_F(LoopCloserTest, EmptyKeyframesAndSecondHypotheses) {
  Map map = openMap(24, 0.05);
  testing::bend(drift_, &map);
  (void)map.addKeyframe({-1, 0, 0, map.keyframes().at(33).T_w_c, {}});
  const Transform flip{expSo3({0.4, 0.2, 0.0}), Eigen::Vector3d::Zero()};
  map.place(12, *map.find(12)->T_w_m, *map.find(12)->T_w_m * flip);
  LoopFrame loop = loopFrame(map, see(testing::roomView(345.0 * kDegree), 0.05));
  loop.reference = 33;
  const auto outcome = close(map, loop);
  ASSERT_TRUE(std::holds_alternative<ClosedLoop>(outcome));
  const Map closed = closedMap(map, outcome);
  EXPECT_LT(keyframeError(closed), 0.05 * keyframeError(map));
  const MapMarker& marker = *closed.find(12);
  // Only its orientation matters (which of the two has the evidence found?); the optimization after
  // Eq. 40 does not move it.
  EXPECT_LT(rotationDistance(marker.other_T_w_m->R, (*marker.T_w_m * flip).R), 0.1);
}

TEST_F(LoopCloserTest, TheGraphSpansTheMap) {
  Map map = openMap(24, 0.05);
  map.removeKeyframe(5);  // ids have gaps
  (void)map.addKeyframe({});
  for (const int edges_per_keyframe : {0, 4}) {
    const Subproblem part = wholePart(map);
    const PoseGraph graph = graphOf(part, edges_per_keyframe);
    const std::vector<KeyframeId>& ids = part.keyframes;
    ASSERT_EQ(ids.size(), map.keyframes().size() - 1) << "all but the one that sees nothing";
    ASSERT_EQ(graph.poses.size(), ids.size());
    const int poses = static_cast<int>(ids.size());
    for (int i = 1; i < poses; ++i) EXPECT_GE(testing::edgesBetween(graph, 0, i), 1);
    if (edges_per_keyframe == 0) {
      EXPECT_EQ(static_cast<int>(graph.edges.size()), poses - 1) << "a tree";
    }
    for (const auto& edge : graph.edges) {
      const auto a = static_cast<std::size_t>(edge.a);
      const auto b = static_cast<std::size_t>(edge.b);
      EXPECT_LT(edgeError(graph.poses[a], graph.poses[b], edge.T_a_b, 1.0).norm(), 1e-9);
      int shared = 0;
      for (const auto& detection : map.keyframes().at(ids[a]).detections) {
        if (map.keyframes().at(ids[b]).find(detection.id) != nullptr) ++shared;
      }
      EXPECT_EQ(edge.weight, shared);
    }
  }
}

TEST_F(LoopCloserTest, TheGraphKeepsClosedLoops) {
  (void)openMap(24, 0.05);
  const auto round = testing::roomViews(0.0, 350.0 * kDegree, 36);
  const Map map = testing::trueMap(camera_, round, markers_, kSize, 0.05, &rng_);
  const PoseGraph graph = graphOf(wholePart(map), 4);
  // A tree is cut somewhere: two neighbours are then most of the round apart.
  for (int i = 0; i < 36; ++i) {
    EXPECT_LE(testing::edgesBetween(graph, i, (i + 1) % 36), 3) << "from keyframe " << i;
  }
}

}  // namespace
}  // namespace waymark::slam
