#include "io/maps/wpilib_map.h"

#include <cmath>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "io/maps/testing_markers.h"

namespace waymark::io {
namespace {

// In the form of WPILib's own field files. Tag 1 faces 120 degrees to the left of the field's x;
// tag 2 is the documentation's zero rotation: upright, facing along x.
const std::string kExample = R"({
  "tags": [
    {"ID": 1, "pose": {
      "translation": {"x": 15.0, "y": 0.25, "z": 1.35},
      "rotation": {"quaternion": {"W": 0.5000000000000001, "X": 0.0, "Y": 0.0,
                                  "Z": 0.8660254037844386}}}},
    {"ID": 2, "pose": {
      "translation": {"x": 0.0, "y": 4, "z": 1.0},
      "rotation": {"quaternion": {"W": 1.0, "X": 0.0, "Y": 0.0, "Z": 0.0}}}}
  ],
  "field": {"length": 16.451, "width": 8.211}
})";

TEST(WpilibMap, ExampleByHand) {
  const auto map = parseWpilibMap(kExample, "f.json");
  ASSERT_TRUE(map) << map.error().message;
  ASSERT_EQ(map->markers.size(), 2U);
  const PosedMarker& turned = map->markers[0];
  EXPECT_EQ(turned.id, 1);
  EXPECT_EQ(turned.size_m, 0.0);  // the file does not say
  const double s = std::sqrt(0.75);
  EXPECT_LT((turned.T_w_m.R.col(0) - Eigen::Vector3d(-s, -0.5, 0.0)).norm(), 1e-12);  // right
  EXPECT_LT((turned.T_w_m.R.col(1) - Eigen::Vector3d(0.0, 0.0, 1.0)).norm(), 1e-12);  // up
  EXPECT_LT((turned.T_w_m.R.col(2) - Eigen::Vector3d(-0.5, s, 0.0)).norm(), 1e-12);   // out
  // Who looks at the zero rotation sees the field's y to the right and its z up.
  expectCorners(map->markers[1], 0.2,
                {{{0.0, 3.9, 1.1}, {0.0, 4.1, 1.1}, {0.0, 4.1, 0.9}, {0.0, 3.9, 0.9}}});
}

TEST(WpilibMap, WrittenByHand) {
  PosedMarkers markers;
  markers.markers = {{2, 0.2, {}}};
  markers.markers[0].T_w_m.p = {3.0, 4.0, 1.0};
  markers.markers[0].T_w_m.R << 0, 0, 1, 1, 0, 0, 0, 1, 0;  // right, up, out = y, z, x
  const auto json = nlohmann::json::parse(formatWpilibMap(markers));
  EXPECT_EQ(json["tags"][0]["ID"], 2);
  EXPECT_EQ(json["tags"][0]["pose"]["translation"]["y"], 4.0);
  EXPECT_NEAR(json["tags"][0]["pose"]["rotation"]["quaternion"]["W"], 1.0, 1e-15);
  EXPECT_EQ(json["field"]["length"], 3.0);
  EXPECT_EQ(json["field"]["width"], 4.0);
}

TEST(WpilibMap, RoundTrip) {
  const PosedMarkers markers = someMarkers();
  auto back = parseWpilibMap(formatWpilibMap(markers), "f.json");
  ASSERT_TRUE(back) << back.error().message;
  expectSameMarkers(*back, markers);
}

// A field is larger than where its tags hang.
TEST(WpilibMap, TheFieldsSizeStays) {
  const auto map = parseWpilibMap(kExample, "f.json");
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_EQ(map->field, (FieldSize{16.451, 8.211}));
  const auto json = nlohmann::json::parse(formatWpilibMap(*map));
  EXPECT_EQ(json["field"]["length"], 16.451);
  EXPECT_EQ(json["field"]["width"], 8.211);
}

TEST(WpilibMap, FaultsNameThePlace) {
  const auto errorOf = [](const std::string& what, const std::string& instead) {
    std::string text = kExample;
    text.replace(text.find(what), what.size(), instead);
    const auto markers = parseWpilibMap(text, "f.json");
    return markers ? "no error" : markers.error().message;
  };
  EXPECT_EQ(errorOf("\"tags\"", "\"tag\""), "f.json: tags: is missing");
  EXPECT_EQ(errorOf("\"W\": 1.0", "\"W\": 0.0"),
            "f.json: tags[1].pose.rotation.quaternion: must not be zero");
  EXPECT_EQ(errorOf("\"W\": 1.0", "\"w\": 1.0"),
            "f.json: tags[1].pose.rotation.quaternion.W: is missing");
  EXPECT_EQ(errorOf("\"ID\": 1", "\"ID\": 1.5"),
            "f.json: tags[0].ID: must be a whole number from 0 to 1000000");
  EXPECT_EQ(errorOf("]", "}"), "f.json:10:3: is not JSON");
}

}  // namespace
}  // namespace waymark::io
