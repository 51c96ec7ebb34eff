#include "slam/map/marker_constraints.h"

#include <cmath>
#include <functional>

#include <gtest/gtest.h>

#include "slam/map/marker_options.h"

namespace waymark::slam {
namespace {

// Of options that are usable but for what is spoiled.
std::string reasonFor(const std::function<void(MarkerOptions*)>& spoil) {
  MarkerOptions options;
  options.size_m = 0.1;
  options.anchors = {{1, {}}};
  MarkerConstraints& known = options.constraints;
  known.positions = {{.id = 2}, {.id = 3}};
  known.planes = {{.name = "north", .ids = {{4, 9}}}, {.ids = {{20, 20}, {22, 23}}}};
  known.upright.ids = {{4, 6}};
  known.distances = {{.id_a = 4, .corner_a = 0, .id_b = 9, .corner_b = 1, .distance_m = 7.0}};
  known.up_w = Eigen::Vector3d::UnitZ();
  spoil(&options);
  return options.invalidReason();
}

TEST(MarkerConstraints, AreEmptyUntilSomethingIsKnown) {
  MarkerConstraints known;
  EXPECT_TRUE(known.empty());
  known.upright.ids = {{1, 2}};
  EXPECT_FALSE(known.empty());
}

// Each mistake by itself.
TEST(MarkerConstraints, SayWhatIsWrongAndWhere) {
  EXPECT_EQ(reasonFor([](auto*) {}), "");
  const auto with = [](const std::function<void(MarkerConstraints*)>& spoil) {
    return reasonFor([&](MarkerOptions* options) { spoil(&options->constraints); });
  };
  using Known = MarkerConstraints;
  EXPECT_EQ(with([](Known* k) {
              k->planes[0].ids = {{4, 4}};
            }),
            "plane \"north\": a plane needs at least two markers");
  EXPECT_EQ(with([](Known* k) {
              k->planes[1].ids.push_back({21, 22});
            }),
            "plane 2: marker 22 is named twice");
  EXPECT_EQ(with([](Known* k) {
              k->planes[1].ids = {{9, 4}};
            }),
            "plane 2: the range of ids 9-4 is empty");
  EXPECT_EQ(with([](Known* k) { k->planes[0].sigma_m = 0.0; }),
            "plane \"north\": its sigmas must be positive");
  EXPECT_EQ(with([](Known* k) { k->positions[1].id = 2; }), "position 2 is given twice");
  EXPECT_EQ(with([](Known* k) { k->positions[1].sigma_m = -1.0; }),
            "position 3: its sigma must be positive");
  EXPECT_EQ(with([](Known* k) { k->positions[0].p_w.x() = NAN; }),
            "position 2: its coordinates must be finite");
  EXPECT_EQ(with([](Known* k) { k->positions[0].id = 1; }),
            "position 1 is an anchor, too; one of them will do");
  EXPECT_EQ(with([](Known* k) { k->upright.sigma_rad = 0.0; }),
            "upright: its sigma must be positive");
  EXPECT_EQ(with([](Known* k) { k->distances[0].id_b = 4; }),
            "distance 4/0 to 4/1: both corners are the same marker's, whose size is known");
  EXPECT_EQ(with([](Known* k) { k->distances[0].corner_b = 4; }),
            "distance 4/0 to 9/4: corners are 0 to 3");
  EXPECT_EQ(with([](Known* k) { k->distances[0].distance_m = 0.0; }),
            "distance 4/0 to 9/1: a distance must be positive");
  EXPECT_EQ(with([](Known* k) { k->distances[0].sigma_m = 0.0; }),
            "distance 4/0 to 9/1: its sigma must be positive");
  EXPECT_EQ(with([](Known* k) {
              k->distances.push_back({.id_a = 9, .corner_a = 1, .id_b = 4, .distance_m = 1.0});
            }),
            "distance 9/1 to 4/0 is given twice");
  EXPECT_EQ(with([](Known* k) { k->up_w = Eigen::Vector3d::Zero(); }),
            "up: the vertical must have a direction");
  EXPECT_EQ(with([](Known* k) { k->gate_sigmas = 0.0; }),
            "the gate of constraints must be positive");
}

TEST(MarkerConstraints, SayWhatDoesNotGoTogether) {
  EXPECT_EQ(reasonFor([](MarkerOptions* o) {
              o->ignored = {{5, 9}};
            }),
            "plane \"north\": marker 9 is among the ignored ids");
  EXPECT_EQ(reasonFor([](MarkerOptions* o) { o->anchors.clear(); }),
            "positions without orientation fix the world from three on; or give an anchor");
  EXPECT_EQ(reasonFor([](MarkerOptions* o) {
              o->anchors.clear();
              o->origin_marker = 1;
            }),
            "surveyed positions and an origin marker both fix the world; only one of them can");
  EXPECT_EQ(reasonFor([](MarkerOptions* o) {
              o->anchors.clear();
              o->constraints.positions.clear();
            }),
            "up is the vertical in a surveyed world; give anchors, positions or an origin marker");
}

}  // namespace
}  // namespace waymark::slam
