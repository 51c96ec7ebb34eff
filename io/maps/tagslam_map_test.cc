#include "io/maps/tagslam_map.h"

#include <string>

#include <gtest/gtest.h>

#include "io/maps/testing_markers.h"

namespace waymark::io {
namespace {

// After TagSLAM's documentation. A third of a turn about (1, 1, 1) takes x to y, y to z, z to x;
// the lab itself is moved by 10 m along z, unturned.
const std::string kExample = R"(default_body: lab
bodies:
  - lab:
      is_static: true    # does not move
      default_tag_size: 0.2
      pose:
        position:
          x: 0.0
          y: 0.0
          z: 10.0
        rotation: {x: 0.0, y: 0.0, z: 0.0}
        position_noise: {x: 0.001, y: 0.001, z: 0.001}
        rotation_noise: {x: 0.001, y: 0.001, z: 0.001}
      tags:
        - id: 7
          size: 0.4
          pose:
            position:
              x: 1.0
              y: 2.0
              z: 3
            rotation:
              x: 1.2091995761561452
              y: 1.2091995761561452
              z: 1.2091995761561452
        - id: 8
          pose:
            position: {x: 0.0, y: 0.0, z: 0.0}
            rotation: {x: 0.0, y: 0.0, z: 0.0}
        - id: 9
  - rig:
      is_static: false
      default_tag_size: 0.1
      tags:
        - id: 30
          pose:
            position: {x: 0.0, y: 0.0, z: 0.0}
            rotation: {x: 0.0, y: 0.0, z: 0.0}
)";

TEST(TagslamMap, ExampleByHand) {
  const auto map = parseTagslamMap(kExample, "t.yaml");
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_EQ(map->dictionary, "");
  ASSERT_EQ(map->markers.size(), 2U);  // 9 has no pose, 30 moves
  const PosedMarker& seven = map->markers[0];
  EXPECT_EQ(seven.id, 7);
  EXPECT_EQ(seven.size_m, 0.4);
  expectCorners(seven, 0.4,
                {{{1.0, 1.8, 13.2}, {1.0, 2.2, 13.2}, {1.0, 2.2, 12.8}, {1.0, 1.8, 12.8}}});
  const PosedMarker& eight = map->markers[1];
  EXPECT_EQ(eight.id, 8);
  EXPECT_EQ(eight.size_m, 0.2);  // the body's
  EXPECT_EQ(eight.T_w_m.p, Eigen::Vector3d(0.0, 0.0, 10.0));
}

TEST(TagslamMap, RoundTrip) {
  const PosedMarkers markers = someMarkers();
  const auto back = parseTagslamMap(formatTagslamMap(markers), "t.yaml");
  ASSERT_TRUE(back) << back.error().message;
  expectSameMarkers(markers, *back);
}

TEST(TagslamMap, FaultsNameThePlace) {
  const auto errorOf = [](const std::string& what, const std::string& instead) {
    std::string text = kExample;
    text.replace(text.find(what), what.size(), instead);
    const auto markers = parseTagslamMap(text, "t.yaml");
    return markers ? "no error" : markers.error().message;
  };
  EXPECT_EQ(errorOf("bodies:", "things:"), "t.yaml: bodies: is missing");
  EXPECT_EQ(errorOf("x: 1.0", "x: wide"),
            "t.yaml: bodies[0].lab.tags[0].pose.position.x: must be a number");
  EXPECT_EQ(errorOf("size: 0.4", "size: 0"),
            "t.yaml: bodies[0].lab.tags[0].size: must be positive");
  EXPECT_EQ(errorOf("id: 7", "id: -7"),
            "t.yaml: bodies[0].lab.tags[0].id: must be a whole number from 0 to 1000000");
  EXPECT_EQ(errorOf("rotation: {x: 0.0, y: 0.0, z: 0.0}", "rotation: {x: 0.0, y: 0.0}"),
            "t.yaml: bodies[0].lab.pose.rotation.z: is missing");
}

}  // namespace
}  // namespace waymark::io
