#include "io/maps/marker_corners.h"

#include <string>

#include <gtest/gtest.h>

#include "io/maps/map_file.h"
#include "io/text/text_file.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using waymark::testing::TemporaryDirectory;

slam::Map twoMarkers() {
  slam::Map map;
  map.dictionary = "APRILTAG_36h11";
  for (const int id : {3, 7, 9}) map.addMarker(id, 0.165);
  const auto delta = (slam::Vector6d() << 0.1, 0.2, 0.3, 0.4, -0.5, 0.6).finished();
  map.place(7, slam::Transform{}.retract(delta));
  map.place(3, slam::Transform{});
  return map;
}

TEST(MarkerCorners, OfAMapFile) {
  const TemporaryDirectory directory;
  const slam::Map map = twoMarkers();
  ASSERT_TRUE(writeTextFile(directory / "map.json", formatMap(map, std::nullopt)).ok());
  const auto markers = readMarkerCorners(directory / "map.json");
  ASSERT_TRUE(markers.ok()) << markers.error().message;
  ASSERT_EQ(markers->size(), 2U);
  EXPECT_EQ((*markers)[0].id, 3);
  EXPECT_EQ((*markers)[0].corners[0], Eigen::Vector3d(-0.0825, 0.0825, 0.0));
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector3d expected = map.markers().at(7).cornersInWorld()[i];
    EXPECT_LT(((*markers)[1].corners[i] - expected).norm(), 1e-13);
  }
}

TEST(MarkerCorners, TheirPieceComesWithThem) {
  const TemporaryDirectory directory;
  const slam::Map first = twoMarkers();
  slam::Map second;
  second.piece = 5;
  second.addMarker(40, 0.1);
  second.place(40, slam::Transform{});
  const std::vector<const slam::Map*> others = {&second};
  ASSERT_TRUE(
      writeTextFile(directory / "map.json", formatMap(first, std::nullopt, 0.0, {}, others)));
  const auto markers = readMarkerCorners(directory / "map.json");
  ASSERT_TRUE(markers.ok()) << markers.error().message;
  ASSERT_EQ(markers->size(), 3U);
  EXPECT_EQ((*markers)[0].piece, 0);
  EXPECT_EQ((*markers)[2].piece, 5);
}

TEST(MarkerCorners, LayoutReadsBack) {
  const TemporaryDirectory directory;
  const std::vector<MarkerCorners> layout = posedMarkerCorners(twoMarkers());
  ASSERT_TRUE(writeMarkerLayout(directory / "gt.json", layout, "a \"note\"").ok());
  const auto back = readMarkerCorners(directory / "gt.json");
  ASSERT_TRUE(back.ok()) << back.error().message;
  ASSERT_EQ(back->size(), layout.size());
  EXPECT_EQ((*back)[1].corners, layout[1].corners);
}

TEST(MarkerCorners, FaultsNameThePlace) {
  const TemporaryDirectory directory;
  const std::string good = R"({"id":1,"size":0.1,"corners":[[0,0,0],[1,0,0],[1,1,0],[0,1,0]]})";
  const std::pair<std::string, std::string> cases[] = {
      {"", "map.json:1:1: is not JSON"},
      {"[1]", "must be an object"},
      {R"({"format":"waymark-map","version":2,"markers":[]})", "version: must be a whole number"},
      {R"({"markers":{}})", "markers: must be a list"},
      {R"({"markers":[5]})", "markers[0]: must be an object"},
      {R"({"markers":[{"id":-1}]})", "markers[0].id: must be a whole number"},
      {R"({"markers":[)" + good + R"(,{"id":2,"size":"big"}]})", "markers[1].size: must be a num"},
      {R"({"markers":[{"id":2,"size":0}]})", "markers[0].size: must be positive"},
      {R"({"markers":[{"id":2,"size":1,"corners":[[0,0,0]]}]})", "[0].corners: must be a list of"},
      {R"({"markers":[{"id":2,"size":1,"corners":[[0,0],[0,0],[0,0],[0,0]]}]})", "corners[0]: "},
      {R"({"markers":[)" + good + "," + good + "]}", "id 1 occurs twice"},
  };
  for (const auto& [text, complaint] : cases) {
    ASSERT_TRUE(writeTextFile(directory / "map.json", text).ok());
    const auto markers = readMarkerCorners(directory / "map.json");
    ASSERT_FALSE(markers.ok()) << text;
    EXPECT_NE(markers.error().message.find("map.json:"), std::string::npos);
    EXPECT_NE(markers.error().message.find(complaint), std::string::npos)
        << markers.error().message;
  }
}

}  // namespace
}  // namespace waymark::io
