// Fixture: a room whose loop is still open, and the frame that closes it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <numbers>
#include <random>
#include <variant>
#include <vector>

#include <gtest/gtest.h>

#include "slam/camera_pose/pose_optimizer.h"
#include "slam/loop_closure/loop_adoption.h"
#include "slam/loop_closure/loop_closer.h"
#include "slam/marker_pose/square_pose.h"
#include "slam/testing/scene.h"

namespace waymark::slam::testing {

// Somebody turned round in a room up to a view that does not show the first markers again; then
// comes the view that shows both ends.
class OpenRoom : public ::testing::Test {
 protected:
  static constexpr double kSize = 0.25;
  static constexpr double kDegree = std::numbers::pi / 180.0;

  // Keyframes every 10 degrees from 0 to 330, which see one to three of the markers each.
  Map openMap(int marker_count, double sigma_px) {
    markers_ = roomMarkers(marker_count, 2.5, &rng_);
    options_.size_m = kSize;
    views_ = roomViews(0.0, 330.0 * kDegree, 34);
    return trueMap(camera_, views_, markers_, kSize, sigma_px, &rng_);
  }

  // What a view shows: as tracked by the markers of the last keyframes, and where the others
  // ("loop markers": seen by none of the last three keyframes) say that it is.
  LoopFrame loopFrame(const Map& map, const std::vector<MarkerDetection>& detections) {
    LoopFrame loop;
    loop.reference = map.keyframes().rbegin()->first;
    std::vector<MarkerDetection> near, far;
    for (const MarkerDetection& detection : detections) {
      const auto seen_by = map.viewsOf(detection.id);
      if (seen_by.empty()) continue;
      (seen_by.back() + 3 > loop.reference ? near : far).push_back(detection);
    }
    EXPECT_FALSE(near.empty());
    EXPECT_FALSE(far.empty());
    const PoseOptimizer optimizer(camera_.focalLength());
    loop.frame.detections = detections;
    loop.frame.T_w_c =
        optimizer.optimize(knownMarkers(map, near), map.keyframes().at(loop.reference).T_w_c)
            ->T_w_c;
    for (const MarkerDetection& detection : far) loop.loop_markers.push_back(detection.id);
    if (far.size() == 1) {
      const auto square = estimateSquarePose(far[0], kSize, camera_.focalLength());
      for (const Transform& T_c_m : square->T_c_m) {
        loop.expected.push_back(*map.find(far[0].id)->T_w_m * T_c_m.inverse());
      }
      if (square->unambiguous(3.0)) loop.expected.resize(1);
    } else {
      const auto known = knownMarkers(map, far);
      const auto guess = map.keyframes().begin()->second.T_w_c;
      loop.expected = {optimizer.optimize(known, guess)->T_w_c};
    }
    return loop;
  }

  std::vector<MarkerDetection> see(const Transform& T_w_c, double sigma_px) {
    return observeAll(camera_, T_w_c, markers_, kSize, sigma_px, &rng_);
  }

  LoopOutcome close(const Map& map, const LoopFrame& loop) {
    return runToCompletion(
        [&](Budget* a) { return closeLoop(map, loop, options_, LoopOptions{}, a); });
  }
  // The map with the loop closed.
  static Map closedMap(const Map& map, const LoopOutcome& outcome) {
    Map closed = map;
    EXPECT_TRUE(adopt(std::get<ClosedLoop>(outcome), {}, &closed));
    return closed;
  }

  [[nodiscard]] Subproblem wholePart(const Map& map) const {
    return runToCompletion(
        [&](Budget* a) { return buildSubproblem(map, wholeMap(map), options_, a); });
  }
  static PoseGraph graphOf(const Subproblem& part, int edges_per_keyframe) {
    return runToCompletion(
        [&](Budget* a) { return covisibilityGraph(part.problem, edges_per_keyframe, a); });
  }

  // Largest errors of position, metres.
  [[nodiscard]] double keyframeError(const Map& map) const {
    double largest = 0.0;
    for (std::size_t i = 0; i < views_.size(); ++i) {
      const auto& T_w_c = map.keyframes().at(static_cast<KeyframeId>(i)).T_w_c;
      largest = std::max(largest, (T_w_c.p - views_[i].p).norm());
    }
    return largest;
  }
  [[nodiscard]] double markerError(const Map& map) const {
    double largest = 0.0;
    for (const auto& marker : markers_) {
      const MapMarker* found = map.findPosed(marker.id);
      if (found == nullptr) continue;
      largest = std::max(largest, (found->T_w_m->p - marker.T_w_m.p).norm());
    }
    return largest;
  }

  std::mt19937 rng_{61};
  CameraModel camera_{testCalibration()};
  std::vector<SyntheticMarker> markers_;
  std::vector<Transform> views_;
  MarkerOptions options_;
  Vector6d drift_ = (Vector6d() << 0.25, -0.15, 0.1, 0.02, -0.03, 0.12).finished();
};

// How many edges lead from one pose of the graph to another; -1 when none do.
inline int edgesBetween(const PoseGraph& graph, int from, int to) {
  std::vector<int> distance(graph.poses.size(), -1);
  distance[static_cast<std::size_t>(from)] = 0;
  for (std::size_t round = 0; round < graph.poses.size(); ++round) {
    for (const auto& edge : graph.edges) {
      const auto relax = [&](int a, int b) {
        const int d = distance[static_cast<std::size_t>(a)];
        int& other = distance[static_cast<std::size_t>(b)];
        if (d >= 0 && (other < 0 || other > d + 1)) other = d + 1;
      };
      relax(edge.a, edge.b);
      relax(edge.b, edge.a);
    }
  }
  return distance[static_cast<std::size_t>(to)];
}

}  // namespace waymark::slam::testing
