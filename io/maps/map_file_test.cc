#include "io/maps/map_file.h"

#include <functional>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "io/text/text_file.h"
#include "slam/camera/undistort_map.h"
#include "slam/testing/synthetic.h"
#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using waymark::testing::TemporaryDirectory;

const slam::Calibration kCamera = slam::testing::testCalibration();

// Everything a map can hold: markers in every state, second poses, former poses, keyframes.
slam::Map sampleMap() {
  slam::Map map;
  map.dictionary = "APRILTAG_36h11";
  slam::Vector6d delta;
  delta << 0.1, 0.2, 0.3, 0.4, -0.5, 0.6;
  slam::Matrix6d covariance = slam::Matrix6d::Constant(1e-8 / 3.0);
  covariance.diagonal().setLinSpaced(1e-6, 2e-6);
  for (const int id : {7, 9, 10, 11}) map.addMarker(id, 0.165);
  for (const slam::Transform& former : {slam::Transform{}.retract(-delta), slam::Transform{}}) {
    map.place(7, former);
    map.quarantine(7);
  }
  map.place(7, slam::Transform{}.retract(delta), slam::Transform{}.retract(2.0 * delta),
            covariance);
  map.setWorldCovariance(7, 3.0 * covariance);
  map.addMarker(3, 0.2);
  map.place(3, slam::Transform{});
  map.ban(10);
  map.place(11, slam::Transform{}.retract(delta));
  map.quarantine(11);

  slam::MarkerDetection seven;
  seven.id = 7;
  seven.hamming = 1;
  seven.pixels.fill({112.5, 100.0 + 1.0 / 3.0});
  seven.covariance.fill((Eigen::Matrix2d() << 2e-7, 1e-8, 1e-8, 1e-7).finished());
  slam::MarkerDetection nine = seven;
  nine.id = 9;
  const slam::CameraModel camera(kCamera);
  for (slam::MarkerDetection* detection : {&seven, &nine}) {
    for (std::size_t k = 0; k < 4; ++k) {
      detection->normalized[k] = *camera.undistort(detection->pixels[k]);
    }
  }
  slam::Keyframe keyframe;
  keyframe.id = 4;
  keyframe.sequence = 120;
  keyframe.monotonic_ns = 1'500'000'001;
  keyframe.T_w_c = slam::Transform{}.retract(-delta);
  keyframe.twist << 0.1, 0.2, 0.3, -0.1, 0.5, 1.0 / 3.0;
  keyframe.detections = {seven, nine};
  map.addKeyframe(keyframe);
  keyframe.id = 6;
  keyframe.twist.setZero();
  keyframe.sequence = 18'000'000'000'000'000'000U;
  keyframe.monotonic_ns = -5;
  keyframe.detections = {seven};
  map.addKeyframe(keyframe);
  return map;
}

std::string sampleText() { return formatMap(sampleMap(), kCamera); }

std::string errorOf(const std::string& text) {
  const Result<MapFile> file = parseMap(text, "m.json");
  return file ? "no error" : file.error().message;
}

// The sample, changed as somebody might who takes the checksum out.
std::string edited(const std::function<void(nlohmann::ordered_json&)>& edit) {
  nlohmann::ordered_json json = nlohmann::ordered_json::parse(sampleText());
  json.erase("checksum");
  edit(json);
  return json.dump();
}

TEST(MapFile, TheFieldsSizeStays) {
  const FieldSize field{16.451, 8.211};
  const std::string text = formatMap(sampleMap(), kCamera, 0.0, field);
  const Result<MapFile> file = parseMap(text, "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->field, field);
  EXPECT_EQ(formatMap(file->map, file->camera, file->readout_s, file->field), text);
  EXPECT_EQ(parseMap(sampleText(), "m.json")->field, std::nullopt) << "nobody said";
}

TEST(MapFile, HasWhatTheFormatPromises) {
  const nlohmann::json json = nlohmann::json::parse(sampleText());
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
  EXPECT_NEAR(marker["T_w_m"]["q"][0], map.markers().at(7).T_w_m->quaternion().w(), 1e-13);
  EXPECT_NEAR(marker["T_w_m"]["q"][3], map.markers().at(7).T_w_m->quaternion().z(), 1e-13);
  EXPECT_NEAR(marker["corners"][1][2], map.markers().at(7).cornersInWorld()[1].z(), 1e-13);
  EXPECT_EQ(json["unposed_markers"][0]["id"], 9);
  EXPECT_EQ(json["unposed_markers"][1]["state"], "refused");
  const nlohmann::json& keyframe = json["keyframes"][0];
  EXPECT_EQ(keyframe["sequence"], 120);
  EXPECT_EQ(keyframe["time_ns"], 1'500'000'001);
  EXPECT_EQ(keyframe["detections"][0]["pixels"][3][1], 100.0 + 1.0 / 3.0);
}

TEST(MapFile, EverythingReadsBack) {
  const slam::Map map = sampleMap();
  const Result<MapFile> file = parseMap(formatMap(map, kCamera), "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_TRUE(file->has_checksum);
  ASSERT_TRUE(file->camera.has_value());
  EXPECT_EQ(file->camera->fx, kCamera.fx);
  EXPECT_EQ(file->camera->distortion, kCamera.distortion);
  EXPECT_EQ(file->map.dictionary, map.dictionary);
  ASSERT_EQ(file->map.markers().size(), map.markers().size());
  for (const auto& [id, marker] : map.markers()) {
    const slam::MapMarker& back = file->map.markers().at(id);
    EXPECT_EQ(back.id, id);
    EXPECT_EQ(back.size_m, marker.size_m);
    EXPECT_EQ(back.state, marker.state);
    ASSERT_EQ(back.T_w_m.has_value(), marker.T_w_m.has_value());
    ASSERT_EQ(back.other_T_w_m.has_value(), marker.other_T_w_m.has_value());
    if (marker.T_w_m) {
      EXPECT_LT((back.T_w_m->R - marker.T_w_m->R).norm(), 1e-13);
      EXPECT_EQ(back.T_w_m->p, marker.T_w_m->p);
    }
    if (marker.other_T_w_m) {
      EXPECT_EQ(back.other_T_w_m->p, marker.other_T_w_m->p);
    }
    EXPECT_EQ(back.covariance, marker.covariance);
    EXPECT_EQ(back.world_covariance, marker.world_covariance);
    ASSERT_EQ(back.former_poses.size(), marker.former_poses.size());
    for (std::size_t i = 0; i < back.former_poses.size(); ++i) {
      EXPECT_EQ(back.former_poses[i].p, marker.former_poses[i].p);
    }
    const auto views = map.viewsOf(id);
    const auto views_back = file->map.viewsOf(id);
    EXPECT_TRUE(std::equal(views.begin(), views.end(), views_back.begin(), views_back.end()));
  }
  ASSERT_EQ(file->map.keyframes().size(), map.keyframes().size());
  for (const auto& [id, keyframe] : map.keyframes()) {
    const slam::Keyframe& back = file->map.keyframes().at(id);
    EXPECT_EQ(back.sequence, keyframe.sequence);
    EXPECT_EQ(back.monotonic_ns, keyframe.monotonic_ns);
    EXPECT_EQ(back.T_w_c.p, keyframe.T_w_c.p);
    EXPECT_EQ(back.twist, keyframe.twist);
    ASSERT_EQ(back.detections.size(), keyframe.detections.size());
    for (std::size_t i = 0; i < back.detections.size(); ++i) {
      EXPECT_EQ(back.detections[i].id, keyframe.detections[i].id);
      EXPECT_EQ(back.detections[i].hamming, keyframe.detections[i].hamming);
      EXPECT_EQ(back.detections[i].pixels, keyframe.detections[i].pixels);
      EXPECT_EQ(back.detections[i].normalized, keyframe.detections[i].normalized);
      EXPECT_EQ(back.detections[i].covariance, keyframe.detections[i].covariance);
    }
  }
}

// "covariance" is the one in the world, its upper triangle row by row.
TEST(MapFile, CovariancesHaveTheirNames) {
  const slam::Map map = sampleMap();
  const nlohmann::json json = nlohmann::json::parse(sampleText());
  const nlohmann::json& seven = json["markers"][1];
  ASSERT_EQ(seven["covariance"].size(), 21U);
  EXPECT_EQ(seven["covariance"][6], map.find(7)->world_covariance(1, 1));
  EXPECT_EQ(seven["covariance_given_keyframes"][6], map.find(7)->covariance(1, 1));
  EXPECT_FALSE(json["markers"][0].contains("covariance")) << "nobody knows it";

  slam::Map exact = map;
  exact.place(7, *map.find(7)->T_w_m);
  exact.setWorldCovariance(7, map.find(7)->world_covariance);
  const auto file = parseMap(formatMap(exact, kCamera), "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->map.find(7)->world_covariance, map.find(7)->world_covariance);
  EXPECT_TRUE(file->map.find(7)->covariance.isZero(0.0));
}

// There it was the one given the keyframes.
TEST(MapFile, AnOlderFileHasOneCovariance) {
  const auto file = parseMap(edited([](auto& json) {
                               auto& marker = json["markers"][1];
                               marker["covariance"] = marker["covariance_given_keyframes"];
                               marker.erase("covariance_given_keyframes");
                             }),
                             "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->map.find(7)->covariance, sampleMap().find(7)->covariance);
  EXPECT_TRUE(file->map.find(7)->world_covariance.isZero(0.0));
}

TEST(MapFile, SavingWhatWasLoadedGivesTheSameBytes) {
  const std::string text = sampleText();
  EXPECT_EQ(text, sampleText());
  const Result<MapFile> file = parseMap(text, "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(formatMap(file->map, file->camera), text);
}

TEST(MapFile, HowWellTheLensIsKnown) {
  slam::Calibration learned = kCamera;
  learned.covariance = slam::IntrinsicMatrix::Constant(1e-5 / 3.0);
  learned.covariance->diagonal().setLinSpaced(1e-4, 3e-4);
  const std::string text = formatMap(sampleMap(), learned);
  const Result<MapFile> file = parseMap(text, "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->camera, learned);
  EXPECT_EQ(formatMap(file->map, file->camera), text);
}

// What a rolling shutter does to the corners is done again when the map is read.
TEST(MapFile, RollingShutter) {
  slam::Map map = sampleMap();
  slam::Transform T_w_m = *map.find(7)->T_w_m;
  T_w_m.p = map.keyframes().at(4).T_w_c * Eigen::Vector3d(0.0, 0.0, 2.0);
  map.place(7, T_w_m, map.find(7)->other_T_w_m, map.find(7)->covariance);
  slam::undistortAgain(slam::CameraModel(kCamera), 0.02, &map);
  const std::string text = formatMap(map, kCamera, 0.02);
  const Result<MapFile> file = parseMap(text, "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(file->readout_s, 0.02);
  EXPECT_EQ(formatMap(file->map, file->camera, file->readout_s), text);
  const auto corner = [](const slam::Map& m) {
    return m.keyframes().at(4).detections[0].normalized[0];
  };
  EXPECT_LT((corner(file->map) - corner(map)).norm(), 1e-9);
  EXPECT_GT((corner(map) - corner(sampleMap())).norm(), 1e-6);
}

// The sample with keyframes that markers were carried to.
slam::Map linkedMap() {
  slam::Map map = sampleMap();
  slam::Vector6d delta;
  delta << 1.0, -2.0, 0.5, 0.3, 1.0 / 3.0, -0.6;
  slam::Matrix6d covariance = slam::Matrix6d::Constant(1e-5 / 3.0);
  covariance.diagonal().setLinSpaced(1e-4, 3e-4);
  map.addLink(6, {3, slam::Transform{}.retract(delta), covariance});
  slam::Keyframe bridge;
  bridge.id = 9;
  bridge.links = {{3, slam::Transform{}.retract(-delta), covariance}, {7, {}, 2.0 * covariance}};
  map.addKeyframe(bridge);
  return map;
}

TEST(MapFile, LinksReadBack) {
  const slam::Map map = linkedMap();
  const std::string text = formatMap(map, kCamera);
  const Result<MapFile> file = parseMap(text, "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(formatMap(file->map, file->camera), text);
  for (const auto& [id, keyframe] : map.keyframes()) {
    const auto& back = file->map.keyframes().at(id).links;
    ASSERT_EQ(back.size(), keyframe.links.size()) << id;
    for (std::size_t i = 0; i < back.size(); ++i) {
      EXPECT_EQ(back[i].marker, keyframe.links[i].marker);
      EXPECT_EQ(back[i].T_c_m.p, keyframe.links[i].T_c_m.p);
      EXPECT_LT((back[i].T_c_m.R - keyframe.links[i].T_c_m.R).norm(), 1e-13);
      EXPECT_EQ(back[i].covariance, keyframe.links[i].covariance);
    }
  }
  EXPECT_EQ(file->map.keyframes().at(9).links.size(), 2U);
  EXPECT_EQ(sampleText().find("links"), std::string::npos) << "without any, not a word of them";
}

TEST(MapFile, FaultsOfLinks) {
  using Edit = std::function<void(nlohmann::ordered_json&)>;  // of the last keyframe's links
  const std::pair<Edit, std::string> cases[] = {
      {[](auto& l) { l[0]["marker"] = 555; }, "links[0].marker: the map has no marker 555 with a"},
      {[](auto& l) { l[1]["marker"] = l[0]["marker"]; }, "links[1].marker: must be larger than"},
      {[](auto& l) { l[0]["marker"] = -1; }, "links[0].marker: must be a whole number"},
      {[](auto& l) { l[0]["marker"] = 3 + (std::int64_t{1} << 32U); }, "links[0].marker: must be"},
      {[](auto& l) { l[0].erase("marker"); }, "links[0].marker: is missing"},
      {[](auto& l) { l[0].erase("T_c_m"); }, "links[0].T_c_m: is missing"},
      {[](auto& l) { l[1]["T_c_m"]["q"][0] = 3.0; }, "links[1].T_c_m.q: must have len"},
      {[](auto& l) { l[0]["covariance"].erase(0); }, "links[0].covariance: must be a list of 21"},
      {[](auto& l) { l[0]["covariance"][0] = 1e13; }, "links[0].covariance: must not exceed"},
      {[](auto& l) { l[0]["covariance"][1] = 1.0; }, "links[0].covariance: must be positive def"},
      {[](auto& l) { l = 4; }, "keyframes[2].links: must be a list"},
  };
  for (const auto& [edit, complaint] : cases) {
    nlohmann::ordered_json json = nlohmann::ordered_json::parse(formatMap(linkedMap(), kCamera));
    json.erase("checksum");
    edit(json["keyframes"][2]["links"]);
    const std::string error = errorOf(json.dump());
    EXPECT_NE(error.find(complaint), std::string::npos) << error << "\n  not: " << complaint;
    EXPECT_EQ(error.find('\n'), std::string::npos) << error;
  }
}

slam::Map mapWithPictures() {
  slam::Map map = linkedMap();
  slam::PicturePrint print;
  print.width_m = 0.3;
  print.height_m = 0.4;
  print.name = "a \"poster\"";
  const int posed = map.addPicture(print).id;
  slam::Transform T_w_m;
  T_w_m.p = {1.0, 2.0, 0.5};
  map.place(posed, T_w_m);
  map.addLink(9, {posed, {}, 1e-6 * slam::Matrix6d::Identity()});
  print.name = "not placed yet";
  map.addPicture(print);
  return map;
}

TEST(MapFile, NaturalMarkersReadBack) {
  const slam::Map map = mapWithPictures();
  const std::string text = formatMap(map, kCamera);
  const Result<MapFile> file = parseMap(text, "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_EQ(formatMap(file->map, file->camera), text);
  const slam::MapMarker* const poster = file->map.find(slam::pictureId("a \"poster\""));
  ASSERT_NE(poster, nullptr);
  EXPECT_EQ(poster->picture, "a \"poster\"");
  EXPECT_EQ(poster->size_m, 0.3);
  EXPECT_EQ(poster->height_m, 0.4);
  EXPECT_EQ(poster->T_w_m->p, Eigen::Vector3d(1.0, 2.0, 0.5));
  EXPECT_NEAR(poster->cornersInWorld()[0].y(), 2.2, 1e-12) << "half its height above the middle";
  EXPECT_EQ(file->map.linkedFrom(poster->id).size(), 1U);
  const slam::MapMarker* const other = file->map.find(slam::pictureId("not placed yet"));
  ASSERT_NE(other, nullptr);
  EXPECT_FALSE(other->T_w_m);
  EXPECT_EQ(sampleText().find("natural"), std::string::npos) << "without any, not a word of them";
}

TEST(MapFile, FaultsOfNaturalMarkers) {
  using Edit = std::function<void(nlohmann::ordered_json&)>;  // of the list
  const std::pair<Edit, std::string> cases[] = {
      {[](auto& l) { l[0].erase("name"); }, "natural_markers[0].name: is missing"},
      {[](auto& l) { l[1]["name"] = l[0]["name"]; }, "natural_markers[1]"},
      {[](auto& l) { l[0]["name"] = "other"; }, "natural_markers[0].id: is not the one that comes"},
      {[](auto& l) { l[0]["width"] = 0; }, "natural_markers[0].width: must be"},
      {[](auto& l) { l[0]["height"] = 1e9; }, "natural_markers[0].height: must be"},
      {[](auto& l) { l[0]["state"] = "odd"; }, "natural_markers[0].state: "},
      {[](auto& l) { l = 4; }, "natural_markers: must be a list"},
  };
  for (const auto& [edit, complaint] : cases) {
    nlohmann::ordered_json json =
        nlohmann::ordered_json::parse(formatMap(mapWithPictures(), kCamera));
    json.erase("checksum");
    edit(json["natural_markers"]);
    const std::string error = errorOf(json.dump());
    EXPECT_NE(error.find(complaint), std::string::npos) << error << "\n  not: " << complaint;
    EXPECT_EQ(error.find('\n'), std::string::npos) << error;
  }
}

TEST(MapFile, MapsWithoutCameraOrAnything) {
  slam::Map map;
  map.dictionary = "4X4_50";
  Result<MapFile> file = parseMap(formatMap(map, std::nullopt), "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_FALSE(file->camera.has_value());
  EXPECT_TRUE(file->map.markers().empty());
}

// Any single wrong or missing byte is noticed: by the checksum, or because it is no JSON any more.
TEST(MapFile, DamageIsNoticed) {
  const std::string text = sampleText();
  for (std::size_t i = 0; i < text.size(); ++i) {
    std::string damaged = text;
    damaged[i] = damaged[i] == '1' ? '2' : '1';
    const std::string error = errorOf(damaged);
    ASSERT_NE(error, "no error") << i;
    ASSERT_EQ(error.find('\n'), std::string::npos);
    ASSERT_NE(errorOf(text.substr(0, i)), "no error") << i;
  }
  std::string damaged = text;
  damaged.replace(damaged.find("0.165"), 5, "0.166");
  EXPECT_EQ(errorOf(damaged),
            "m.json: checksum: does not match: the file is damaged, or was edited; take the line "
            "out to use it");
}

TEST(MapFile, AnEditedFileIsTakenWithoutItsChecksum) {
  const Result<MapFile> file = parseMap(edited([](auto& json) {
                                          json["markers"][0]["T_w_m"]["p"][2] = 4.0;
                                          json["markers"][0].erase("corners");
                                        }),
                                        "m.json");
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_FALSE(file->has_checksum);
  EXPECT_EQ(file->map.find(3)->T_w_m->p.z(), 4.0);
}

TEST(MapFile, FaultsNameFilePlaceAndReason) {
  using Edit = std::function<void(nlohmann::ordered_json&)>;
  const std::pair<Edit, std::string> cases[] = {
      {[](auto& j) { j["format"] = "map"; }, "m.json: format: must be \"waymark-map\""},
      {[](auto& j) { j.erase("format"); }, "m.json: format: is missing"},
      {[](auto& j) { j["version"] = 2; }, "m.json: version: is 2, this program reads 1"},
      {[](auto& j) { j["colour"] = 1; }, "m.json: colour: unknown key"},
      {[](auto& j) { j["dictionary"] = "5X5"; }, "m.json: dictionary: \"5X5\" is not a known"},
      {[](auto& j) { j["camera"]["fx"] = "wide"; }, "m.json: camera.fx: must be a number"},
      {[](auto& j) { j["camera"]["fx"] = -1.0; }, "m.json: camera: focal lengths must be pos"},
      {[](auto& j) { j["camera"] = nullptr; }, "m.json: camera: must be there: keyframes are"},
      {[](auto& j) { j["camera"]["distortion_model"] = "odd"; }, "camera.distortion_model: must"},
      {[](auto& j) { j["camera"]["readout_s"] = -2; }, "camera.readout_s: must be -1 to 1"},
      {[](auto& j) { j["camera"]["intrinsics_covariance"] = std::vector<double>(45, -1.0); },
       "camera.intrinsics_covariance: must not have a negative variance"},
      {[](auto& j) { j["keyframes"][0]["twist"].erase(0); }, "keyframes[0].twist: must be a list"},
      {[](auto& j) { j["camera"]["distortion"].erase(7); }, "camera.distortion: must be a list"},
      {[](auto& j) { j.erase("markers"); }, "m.json: markers: is missing"},
      {[](auto& j) { j["markers"][1]["id"] = 3; }, "markers[1].id: the marker 3 occurs twice"},
      {[](auto& j) { j["unposed_markers"][0]["id"] = 3; }, "unposed_markers[0].id: the marker 3"},
      {[](auto& j) { j["markers"][1]["id"] = 587; }, "markers[1].id: must be a whole number fro"},
      {[](auto& j) { j["markers"][1]["size"] = 0; }, "markers[1].size: must be positive"},
      {[](auto& j) { j["markers"][1]["dictionary"] = "4X4_50"; }, "is not the map's"},
      {[](auto& j) { j["markers"][1].erase("T_w_m"); }, "markers[1].T_w_m: is missing"},
      {[](auto& j) { j["markers"][1]["T_w_m"]["q"][0] = 2.0; }, "T_w_m.q: must have length 1"},
      {[](auto& j) { j["markers"][1]["T_w_m"]["p"][0] = nullptr; }, "p[0]: must be a number"},
      {[](auto& j) { j["markers"][1]["T_w_m"]["p"].push_back(0); }, "p: must be a list of 3"},
      {[](auto& j) { j["markers"][1]["T_w_m"]["p"][0] = 9.0; }, "[1].corners: are not where"},
      {[](auto& j) { j["markers"][1]["state"] = "lost"; }, "markers[1].state: must be \"mapped\""},
      {[](auto& j) { j["markers"][1]["state"] = "refused"; }, "markers[1].state: must be \"mapp"},
      {[](auto& j) { j["unposed_markers"][0]["state"] = "mapped"; }, "must not be \"mapped\""},
      {[](auto& j) { j["unposed_markers"][0]["other_T_w_m"] = j["markers"][1]["other_T_w_m"]; },
       "unposed_markers[0].other_T_w_m: must not be there without a first pose"},
      {[](auto& j) { j["markers"][1]["covariance"].erase(0); }, "covariance: must be a list of"},
      {[](auto& j) { j["markers"][1]["covariance"][0] = -1; }, "must not have a negative vari"},
      {[](auto& j) { j["markers"][1]["covariance"][1] = 1.0; },
       "must not have a negative variance"},
      {[](auto& j) { j["markers"][1]["covariance_given_keyframes"][0] = "a"; },
       "covariance_given_keyframes[0]: must be a number"},
      {[](auto& j) { j["keyframes"][1]["index"] = 4; }, "keyframes[1].index: must be larger"},
      {[](auto& j) { j["keyframes"][0]["sequence"] = -1; }, "keyframes[0].sequence: must be"},
      {[](auto& j) { j["keyframes"][0]["time_ns"] = 1.5; }, "keyframes[0].time_ns: must be"},
      {[](auto& j) { j["keyframes"][0]["detections"][1]["id"] = 12; },
       "keyframes[0].detections[1].id: the map has no marker 12"},
      {[](auto& j) { j["keyframes"][0]["detections"][1]["id"] = 7; }, "[1].id: must be larger"},
      {[](auto& j) { j["keyframes"][0]["detections"][0]["pixels"][2][0] = 1e7; },
       "keyframes[0].detections[0].pixels[2]: the camera's lens cannot see there"},
      {[](auto& j) { j["keyframes"][0]["detections"][0]["normalised_covariance"][3][0] = 0.0; },
       "normalised_covariance[3]: must be xx, xy, yy of a positive definite matrix"},
      // Numbers that nothing real has, and that reckoning would turn into none.
      {[](auto& j) { j["markers"][1]["size"] = 1e4; }, "size: must be from 0.0001 to 1000 m"},
      {[](auto& j) { j["markers"][1]["T_w_m"]["p"][0] = 1e9; }, "p: is farther away than 100000"},
      {[](auto& j) { j["markers"][1]["covariance"][0] = 1e13; }, "must not exceed 1e+12"},
      {[](auto& j) { j["camera"]["fx"] = 1e-5; }, "focal lengths must be from 0.001"},
      {[](auto& j) { j["camera"]["distortion"][0] = 1e99; }, "distortion has a value beyond"},
      {[](auto& j) { j["keyframes"][0]["twist"][5] = -1e5; }, "twist: must not exceed"},
      {[](auto& j) { j["keyframes"][0]["time_ns"] = std::int64_t{1} << 62U; }, "time_ns: must be"},
      {[](auto& j) { j["keyframes"][1]["index"] = INT64_MAX; }, "index: must be"},
      {[](auto& j) { j["keyframes"][0]["detections"][0]["normalised_covariance"][3][0] = 1e-30; },
       "normalised_covariance[3]: must be xx, xy, yy"},
      {[](auto& j) { j["col\nour"] = 1; }, "m.json: col our: unknown key"},
  };
  for (const auto& [edit, complaint] : cases) {
    const std::string error = errorOf(edited(edit));
    EXPECT_NE(error.find(complaint), std::string::npos) << error << "\n  not: " << complaint;
    EXPECT_EQ(error.find('\n'), std::string::npos) << error;
  }
}

TEST(MapFile, ReadsFiles) {
  const TemporaryDirectory directory;
  ASSERT_TRUE(writeTextFile(directory / "map.json", sampleText()));
  EXPECT_TRUE(readMap(directory / "map.json"));
  EXPECT_NE(readMap(directory / "none.json").error().message.find("none.json: cannot be read"),
            std::string::npos);
}

TEST(MapFile, KeepsAMapInPieces) {
  slam::Map first = sampleMap();
  slam::Map second = sampleMap();
  second.piece = 3;
  for (const int id : {3, 7}) second.quarantine(id);
  second.setElsewhere(7, true);
  second.addMarker(20, 0.165);
  second.place(20, slam::Transform{});
  const slam::Map* const others[] = {&second};
  const std::string text = formatMap(first, kCamera, 0.0, {}, others);
  const Result<MapFile> read = parseMap(text, "m.json");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->map.piece, 0);
  ASSERT_EQ(read->other_pieces.size(), 1U);
  const slam::Map& piece = read->other_pieces[0];
  EXPECT_EQ(piece.piece, 3);
  EXPECT_EQ(piece.markers().size(), second.markers().size());
  EXPECT_EQ(piece.find(7)->state, slam::MarkerState::kElsewhere);
  EXPECT_NE(piece.findPosed(20), nullptr);
  EXPECT_EQ(read->map.findPosed(20), nullptr);
  EXPECT_EQ(piece.keyframes().size(), second.keyframes().size());
  const slam::Map* const others_read[] = {&piece};
  EXPECT_EQ(formatMap(read->map, read->camera, 0.0, {}, others_read), text);
}

TEST(MapFile, AMarkerHasAPoseInOnePieceOnly) {
  const slam::Map first = sampleMap();
  slam::Map second = sampleMap();
  second.piece = 1;
  const slam::Map* const others[] = {&second};
  const std::string text = formatMap(first, kCamera, 0.0, {}, others);
  EXPECT_NE(errorOf(text).find("has a pose in two pieces"), std::string::npos) << errorOf(text);
}

}  // namespace
}  // namespace waymark::io
