#include "io/maps/aruco_map.h"

#include <string>

#include <gtest/gtest.h>

#include "io/maps/testing_markers.h"

namespace waymark::io {
namespace {

// As ArUco's MarkerMap::saveToFile writes through OpenCV: a marker of 2 m that faces along x, and
// one of 0.1 m flat on the floor.
const std::string kExample = R"(%YAML:1.0
---
aruco_bc_dict: TAG36h11
aruco_bc_nmarkers: 2
aruco_bc_mInfoType: 1
aruco_bc_markers:
   - { id:0, corners:[ [ 5., -1., 1. ], [ 5., 1., 1. ], [ 5., 1., -1. ], [
       5., -1., -1. ] ] }
   - { id:17, corners:[ [ -5.0000000000000003e-02,
       5.0000000000000003e-02, 0. ], [ 5.0000000000000003e-02,
       5.0000000000000003e-02, 0. ], [ 5.0000000000000003e-02,
       -5.0000000000000003e-02, 0. ], [ -5.0000000000000003e-02,
       -5.0000000000000003e-02, 0. ] ] }
)";

std::string errorOf(std::string text, const std::string& what, const std::string& instead) {
  text.replace(text.find(what), what.size(), instead);
  const auto markers = parseArucoMap(text, "m.yml");
  return markers ? "no error" : markers.error().message;
}

TEST(ArucoMap, ExampleByHand) {
  const auto map = parseArucoMap(kExample, "m.yml");
  ASSERT_TRUE(map) << map.error().message;
  EXPECT_EQ(map->dictionary, "APRILTAG_36h11");
  ASSERT_EQ(map->markers.size(), 2U);
  const PosedMarker& wall = map->markers[0];
  EXPECT_EQ(wall.id, 0);
  EXPECT_NEAR(wall.size_m, 2.0, 1e-12);
  EXPECT_LT((wall.T_w_m.p - Eigen::Vector3d(5.0, 0.0, 0.0)).norm(), 1e-12);
  EXPECT_LT((wall.T_w_m.R.col(0) - Eigen::Vector3d::UnitY()).norm(), 1e-12);  // right
  EXPECT_LT((wall.T_w_m.R.col(1) - Eigen::Vector3d::UnitZ()).norm(), 1e-12);  // up
  EXPECT_LT((wall.T_w_m.R.col(2) - Eigen::Vector3d::UnitX()).norm(), 1e-12);  // out
  const PosedMarker& floor = map->markers[1];
  EXPECT_EQ(floor.id, 17);
  EXPECT_NEAR(floor.size_m, 0.1, 1e-12);
  EXPECT_LT((floor.T_w_m.R - Eigen::Matrix3d::Identity()).norm(), 1e-12);
}

TEST(ArucoMap, RoundTrip) {
  const PosedMarkers markers = someMarkers();
  const std::string text = formatArucoMap(markers);
  const auto back = parseArucoMap(text, "m.yml");
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->dictionary, markers.dictionary);
  expectSameMarkers(markers, *back);
}

TEST(ArucoMap, DictionaryNames) {
  for (const auto& [ours, theirs] :
       {std::pair("ARUCO_ORIGINAL", "ARUCO"), std::pair("ARUCO_MIP_36h12", "ARUCO_MIP_36h12"),
        std::pair("APRILTAG_16h5", "TAG16h5"), std::pair("4X4_50", "4X4_50")}) {
    PosedMarkers markers = someMarkers();
    markers.dictionary = ours;
    const std::string text = formatArucoMap(markers);
    EXPECT_NE(text.find("aruco_bc_dict: \"" + std::string(theirs) + "\"\n"), text.npos) << text;
    EXPECT_EQ(parseArucoMap(text, "m.yml")->dictionary, ours);
  }
  std::string unknown = kExample;
  unknown.replace(unknown.find("TAG36h11"), 8, "CHILITAGS");
  EXPECT_EQ(parseArucoMap(unknown, "m.yml")->dictionary, "");
}

TEST(ArucoMap, FaultsNameThePlace) {
  EXPECT_EQ(errorOf(kExample, "mInfoType: 1", "mInfoType: 0"),
            "m.yml: aruco_bc_mInfoType: is 0, pixels; only maps in metres (1) can be read");
  EXPECT_EQ(errorOf(kExample, "nmarkers: 2", "nmarkers: 3"),
            "m.yml: aruco_bc_markers: must be a list of 3");
  EXPECT_EQ(errorOf(kExample, "[ 5., 1., 1. ]", "[ 5., 2., 1. ]"),
            "m.yml: aruco_bc_markers[0].corners: are not the corners of a square");
  EXPECT_EQ(errorOf(kExample, "[ 5., 1., 1. ]", "[ 5., 1. ]"),
            "m.yml: aruco_bc_markers[0].corners[1]: must be a list of 3");
  EXPECT_EQ(errorOf(kExample, "id:17", "name:17"), "m.yml: aruco_bc_markers[1].id: is missing");
  EXPECT_EQ(errorOf(kExample, "aruco_bc_nmarkers", "nmarkers"),
            "m.yml: aruco_bc_nmarkers: is missing");
  EXPECT_EQ(errorOf(kExample, "] ] }", "] "), "m.yml:9:4: is not YAML: illegal block entry");
  EXPECT_EQ(parseArucoMap("", "m.yml").error().message, "m.yml: is not YAML");
}

}  // namespace
}  // namespace waymark::io
