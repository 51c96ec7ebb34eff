// Loops over what was carried through a gap: keyframes that hang by a link (MarkerLink).
#include <cstddef>
#include <variant>
#include <vector>

#include <gtest/gtest.h>

#include "slam/loop_closure/loop_closer.h"
#include "slam/loop_closure/testing_open_room.h"
#include "slam/optimization/map_optimizer.h"

namespace waymark::slam {
namespace {

// Half way round there was nothing but natural features: the second half of the room shares no
// marker with the first.
class LoopLinksTest : public testing::OpenRoom {
 protected:
  static constexpr KeyframeId kSecondHalf = 17;

  Map halves() {
    Map map = openMap(36, 0.05);
    for (const auto& [id, marker] : map.markers()) {
      const auto views = map.viewsOf(id);
      if (views.empty() || views.front() >= kSecondHalf) continue;
      std::vector<KeyframeId> later;
      for (const KeyframeId view : views) {
        if (view >= kSecondHalf) later.push_back(view);
      }
      map.removeViews(id, later);
    }
    anchor_ = map.keyframes().at(kSecondHalf - 1).detections[0].id;
    linked_ = kSecondHalf;
    while (map.keyframes().at(linked_).detections.empty()) ++linked_;
    return map;
  }
  // The anchor as seen from where the map has the keyframe, known so well.
  void link(double sigma_m, double sigma_rad, Map* map) const {
    MarkerLink link{
        .marker = anchor_,
        .T_c_m = map->keyframes().at(linked_).T_w_c.inverse() * *map->findPosed(anchor_)->T_w_m};
    link.covariance.setZero();
    link.covariance.diagonal().head<3>().setConstant(sigma_m * sigma_m);
    link.covariance.diagonal().tail<3>().setConstant(sigma_rad * sigma_rad);
    map->addLink(linked_, link);
  }
  // The second half was carried to the wrong place, and the link says so.
  Map drifted(double sigma_m, double sigma_rad) {
    Map map = halves();
    link(sigma_m, sigma_rad, &map);
    (void)optimizeGlobally(&map, options_, {.max_iterations = 50});
    const Transform drift = Transform{}.retract(drift_);
    for (const auto& [id, marker] : map.markers()) {
      const auto views = map.viewsOf(id);
      if (views.empty() || views.front() < kSecondHalf) continue;
      map.place(id, drift * *marker.T_w_m, marker.other_T_w_m, marker.covariance);
    }
    for (const auto& [id, keyframe] : map.keyframes()) {
      if (id >= kSecondHalf) map.setKeyframePose(id, drift * keyframe.T_w_c);
    }
    link(sigma_m, sigma_rad, &map);
    return map;
  }
  // How far the anchor is from where the link has it, metres.
  [[nodiscard]] double linkError(const Map& map) const {
    const Keyframe& keyframe = map.keyframes().at(linked_);
    const Transform T_w_m = keyframe.T_w_c * keyframe.links.at(0).T_c_m;
    return (T_w_m.p - map.findPosed(anchor_)->T_w_m->p).norm();
  }
  LoopOutcome close(const Map& map) {
    const LoopFrame loop = loopFrame(map, see(testing::roomView(340.0 * kDegree), 0.05));
    EXPECT_EQ(loop.expected.size(), 1U);
    return OpenRoom::close(map, loop);
  }

  int anchor_ = -1;         // of the first half
  KeyframeId linked_ = -1;  // of the second
};

TEST_F(LoopLinksTest, AreEdgesOfTheGraphThatBendFirst) {
  Map map = halves();
  {
    const PoseGraph graph = graphOf(wholePart(map), 4);
    const int last = static_cast<int>(graph.poses.size()) - 1;
    EXPECT_EQ(testing::edgesBetween(graph, 0, last), -1) << "nothing ties the halves";
  }
  link(0.05, 0.02, &map);
  const Subproblem part = wholePart(map);
  const PoseGraph graph = graphOf(part, 4);
  EXPECT_GE(testing::edgesBetween(graph, 0, static_cast<int>(graph.poses.size()) - 1), 1);
  int across = 0;
  for (const PoseGraph::Edge& edge : graph.edges) {
    const auto a = static_cast<std::size_t>(edge.a);
    const auto b = static_cast<std::size_t>(edge.b);
    if ((part.keyframes[a] < kSecondHalf) == (part.keyframes[b] < kSecondHalf)) continue;
    ++across;
    EXPECT_NE(map.keyframes().at(part.keyframes[a]).find(anchor_), nullptr);
    EXPECT_EQ(part.keyframes[b], linked_);
    EXPECT_LT(edge.weight, 1.0) << "one marker seen together";
    EXPECT_LT(edgeError(graph.poses[a], graph.poses[b], edge.T_a_b, 1.0).norm(), 1e-9);
  }
  EXPECT_EQ(across, 1);
}

// The drift was in the gap, and goes there.
TEST_F(LoopLinksTest, TheLoopGoesOverALinkThatIsKnownBadly) {
  const Map map = drifted(0.3, 0.2);
  ASSERT_GT(markerError(map), 0.2);
  ASSERT_LT(linkError(map), 1e-9);
  const auto outcome = close(map);
  ASSERT_TRUE(std::holds_alternative<ClosedLoop>(outcome));
  const Map closed = closedMap(map, outcome);
  EXPECT_LT(markerError(closed), 0.25 * markerError(map));
  EXPECT_GT(linkError(closed), 0.2);
}

// What was carried so well has not drifted: the loop's marker hangs elsewhere.
TEST_F(LoopLinksTest, ALinkThatIsKnownWellContradictsALoop) {
  const Map map = drifted(1e-4, 1e-4);
  const auto outcome = close(map);
  ASSERT_TRUE(std::holds_alternative<LoopRejection>(outcome));
  EXPECT_EQ(std::get<LoopRejection>(outcome), LoopRejection::kContradicted);
}

}  // namespace
}  // namespace waymark::slam
