#include "io/map_file.h"

#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "io/text_file.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using waymark::testing::TemporaryDirectory;

slam::Map sampleMap() {
  slam::Map map;
  map.dictionary = "APRILTAG_36h11";
  slam::Vector6d delta;
  delta << 0.1, 0.2, 0.3, 0.4, -0.5, 0.6;
  map.addMarker(7, 0.165).T_w_m = slam::Transform{}.retract(delta);
  map.addMarker(3, 0.165).T_w_m = slam::Transform{};
  map.addMarker(9, 0.165);
  slam::MarkerDetection detection;
  detection.id = 7;
  detection.pixels.fill({12.5, 1.0 / 3.0});
  detection.normalised.fill({0.1, 0.2});
  detection.covariance.fill(Eigen::Matrix2d::Identity() * 1e-7);
  map.addKeyframe({4, 120, 1'500'000'001, slam::Transform{}.retract(-delta), {detection}});
  return map;
}

TEST(MapFile, HasWhatTheFormatPromises) {
  const nlohmann::json json = nlohmann::json::parse(formatMap(sampleMap(), {.width = 640}));
  EXPECT_EQ(json["format"], "waymark-map");
  EXPECT_EQ(json["version"], 1);
  EXPECT_EQ(json["camera"]["width"], 640);
  ASSERT_EQ(json["markers"].size(), 2U);
  const nlohmann::json& marker = json["markers"][1];
  const slam::Map map = sampleMap();
  EXPECT_EQ(marker["dictionary"], "APRILTAG_36h11");
  EXPECT_EQ(marker["id"], 7);
  EXPECT_EQ(marker["size"], 0.165);
  EXPECT_EQ(marker["T_w_m"]["p"][0], 0.1);
  EXPECT_EQ(marker["T_w_m"]["q"][0], map.markers().at(7).T_w_m->quaternion().w());
  EXPECT_EQ(marker["T_w_m"]["q"][3], map.markers().at(7).T_w_m->quaternion().z());
  EXPECT_EQ(json["unposed_markers"][0]["id"], 9);
  const nlohmann::json& keyframe = json["keyframes"][0];
  EXPECT_EQ(keyframe["sequence"], 120);
  EXPECT_EQ(keyframe["time_ns"], 1'500'000'001);
  EXPECT_EQ(keyframe["detections"][0]["pixels"][3][1], 1.0 / 3.0);
}

TEST(MapFile, CornersReadBack) {
  const TemporaryDirectory directory;
  const slam::Map map = sampleMap();
  ASSERT_TRUE(writeTextFile(directory / "map.json", formatMap(map, {})).ok());
  const auto markers = readMarkerCorners(directory / "map.json");
  ASSERT_TRUE(markers.ok()) << markers.error().message;
  ASSERT_EQ(markers->size(), 2U);
  EXPECT_EQ((*markers)[0].id, 3);
  EXPECT_EQ((*markers)[0].corners[0], Eigen::Vector3d(-0.0825, 0.0825, 0.0));
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ((*markers)[1].corners[i], *map.markers().at(7).T_w_m * slam::markerCorners(0.165)[i]);
  }
}

TEST(MapFile, LayoutReadsBack) {
  const TemporaryDirectory directory;
  const std::vector<MarkerCorners> layout = posedMarkerCorners(sampleMap());
  ASSERT_TRUE(writeMarkerLayout(directory / "gt.json", layout, "a \"note\"").ok());
  const auto back = readMarkerCorners(directory / "gt.json");
  ASSERT_TRUE(back.ok()) << back.error().message;
  ASSERT_EQ(back->size(), layout.size());
  EXPECT_EQ((*back)[1].corners, layout[1].corners);
}

TEST(MapFile, EmptyMapIsStillJson) {
  const nlohmann::json json = nlohmann::json::parse(formatMap(slam::Map{}, {}));
  EXPECT_TRUE(json["markers"].empty());
  EXPECT_TRUE(json["keyframes"].empty());
}

TEST(MapFile, FaultsNameThePlace) {
  const TemporaryDirectory directory;
  const std::string good = R"({"id":1,"size":0.1,"corners":[[0,0,0],[1,0,0],[1,1,0],[0,1,0]]})";
  const std::pair<std::string, std::string> cases[] = {
      {"", "is not a JSON object"},
      {"[1]", "is not a JSON object"},
      {R"({"format":"waymark-map","version":2,"markers":[]})", "\"version\" is 2"},
      {R"({"markers":{}})", "\"markers\" must be a list"},
      {R"({"markers":[5]})", "markers[0]: \"id\""},
      {R"({"markers":[{"id":-1}]})", "markers[0]: \"id\""},
      {R"({"markers":[)" + good + R"(,{"id":2,"size":"big"}]})", "markers[1]: \"size\""},
      {R"({"markers":[{"id":2,"size":0}]})", "markers[0]: \"size\" must be positive"},
      {R"({"markers":[{"id":2,"size":1,"corners":[[0,0,0]]}]})", "markers[0]: \"corners\""},
      {R"({"markers":[{"id":2,"size":1,"corners":[[0,0],[0,0],[0,0],[0,0]]}]})", "\"corners\""},
      {R"({"markers":[)" + good + "," + good + "]}", "id 1 occurs twice"},
  };
  for (const auto& [text, complaint] : cases) {
    ASSERT_TRUE(writeTextFile(directory / "map.json", text).ok());
    const auto markers = readMarkerCorners(directory / "map.json");
    ASSERT_FALSE(markers.ok()) << text;
    EXPECT_NE(markers.error().message.find("map.json: "), std::string::npos);
    EXPECT_NE(markers.error().message.find(complaint), std::string::npos)
        << markers.error().message;
  }
}

}  // namespace
}  // namespace waymark::io
