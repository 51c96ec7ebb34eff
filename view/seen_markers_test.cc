#include "view/seen_markers.h"

#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "view/live_state.h"

namespace waymark::view {
namespace {

using io::Json;

std::string base64Of(const std::string& text) {
  return base64(std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
}

// A camera of 640x480 at the origin, and marker 7, 0.2 m wide, 2 m before it, facing it.
struct Scene {
  Scene() {
    lens.width = 640;
    lens.height = 480;
    lens.fx = lens.fy = 500.0;
    lens.cx = 320.0;
    lens.cy = 240.0;
    pose.sequence = 5;
    pose.source = pose_t::SOURCE_MARKERS;
    pose.q_w_c[0] = 1.0;
    map[0].markers.resize(1);
    marker_t& m = map[0].markers[0];
    m.id = 7;
    m.size = 0.2;
    m.p_w_m[2] = 2.0;
    m.q_w_m[1] = 1.0;  // half a turn about x: its y is up where the camera's is down
    detections.sequence = 5;
    detections.detections.resize(1);
    detections.detections[0].id = 7;
  }
  [[nodiscard]] Json seen() const { return seenMarkers(detections, &pose, &lens, map); }

  lens_t lens{};
  pose_t pose{};
  detections_t detections{};
  std::map<std::int32_t, map_t> map;
};

TEST(SeenMarkers, TellsWhereMapAndPosePutTheCorners) {
  const Scene scene;
  const Json seen = scene.seen();
  ASSERT_EQ(seen.size(), 1U);
  const Json& corners = seen[0].at("expected");
  const double expected[4][2] = {{295, 215}, {345, 215}, {345, 265}, {295, 265}};
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(corners[i][0], expected[i][0], 1e-9) << i;
    EXPECT_NEAR(corners[i][1], expected[i][1], 1e-9) << i;
  }
}

TEST(SeenMarkers, TellsNoCornersWithoutAllThatTheyNeed) {
  Scene scene;
  EXPECT_FALSE(
      seenMarkers(scene.detections, nullptr, &scene.lens, scene.map)[0].contains("expected"));
  EXPECT_FALSE(
      seenMarkers(scene.detections, &scene.pose, nullptr, scene.map)[0].contains("expected"));
  scene.lens.fx = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(scene.seen()[0].contains("expected"));
  Scene other_frame;
  other_frame.pose.sequence = 6;
  EXPECT_FALSE(other_frame.seen()[0].contains("expected"));
  Scene other_piece;
  other_piece.map[0].markers[0].map_piece = 1;
  EXPECT_FALSE(other_piece.seen()[0].contains("expected"));
  Scene behind;
  behind.map[0].markers[0].p_w_m[2] = -2.0;
  EXPECT_FALSE(behind.seen()[0].contains("expected"));
}

// The same camera, and a picture of 0.4 x 0.2 m, 2 m before it.
struct PictureScene : Scene {
  PictureScene() {
    natural[0].markers.resize(1);
    natural_marker_t& m = natural[0].markers[0];
    m.id = 1 << 30;
    m.name = "poster";
    m.width = 0.4;
    m.height = 0.2;
    m.p_w_m[2] = 2.0;
    m.q_w_m[1] = 1.0;
    detections.monotonic_ns = 5'000'000'000;
  }
  // In frame `sequence` it is found where the camera is `distance_m` from it.
  void find(std::int64_t sequence, double distance_m, std::int64_t told_ns) {
    FoundPicture& picture = found[1 << 30];
    picture.detection.sequence = sequence;
    picture.detection.p_m_c[2] = distance_m;
    picture.detection.q_m_c[1] = 1.0;
    picture.monotonic_ns = told_ns;
  }
  [[nodiscard]] Json seenPicture() const {
    const Json seen = seenPictures(detections, &pose, &lens, natural, found);
    return seen.size() == 1 ? seen[0] : Json();
  }

  std::map<std::int32_t, natural_map_t> natural;
  FoundPictures found;
};

void expectCorners(const Json& corners, double x, double y) {
  ASSERT_EQ(corners.size(), 4U);
  const double expected[4][2] = {
      {320 - x, 240 - y}, {320 + x, 240 - y}, {320 + x, 240 + y}, {320 - x, 240 + y}};
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(corners[i][0], expected[i][0], 1e-9) << i;
    EXPECT_NEAR(corners[i][1], expected[i][1], 1e-9) << i;
  }
}

TEST(SeenPictures, AreWhereMapAndPosePutThem) {
  PictureScene scene;
  const Json seen = scene.seenPicture();
  EXPECT_EQ(seen["name"], "poster");
  EXPECT_EQ(seen["lately"], false);
  EXPECT_FALSE(seen.contains("corners"));
  expectCorners(seen["expected"], 50, 25);
  scene.natural[0].markers[0].height = 0.0;
  expectCorners(scene.seenPicture()["expected"], 50, 50);
}

TEST(SeenPictures, AreWhereTheyWereFoundInThatVeryFrame) {
  PictureScene scene;
  scene.find(5, 1.0, 5'200'000'000);
  expectCorners(scene.seenPicture()["corners"], 100, 50);
  expectCorners(scene.seenPicture()["expected"], 50, 25);
  EXPECT_EQ(scene.seenPicture()["lately"], true);
  scene.pose.sequence = 4;
  EXPECT_TRUE(scene.seenPicture().contains("corners")) << "needs no pose";
  EXPECT_FALSE(scene.seenPicture().contains("expected"));
}

TEST(SeenPictures, FoundInAnEarlierFrameAreFoundLately) {
  PictureScene scene;
  scene.find(2, 1.0, 4'500'000'000);
  EXPECT_FALSE(scene.seenPicture().contains("corners"));
  EXPECT_EQ(scene.seenPicture()["lately"], true);
  scene.find(2, 1.0, 3'500'000'000);
  EXPECT_EQ(scene.seenPicture()["lately"], false);
}

TEST(SeenPictures, WhatCannotBeSeenIsNotThere) {
  PictureScene from_behind;
  from_behind.natural[0].markers[0].q_w_m[1] = 0.0;
  from_behind.natural[0].markers[0].q_w_m[0] = 1.0;
  EXPECT_TRUE(from_behind.seenPicture().is_null());
  PictureScene behind;
  behind.natural[0].markers[0].p_w_m[2] = -2.0;
  EXPECT_TRUE(behind.seenPicture().is_null());
  PictureScene beside;
  beside.natural[0].markers[0].p_w_m[0] = 1.5;
  EXPECT_TRUE(beside.seenPicture().is_null());
  PictureScene other_piece;
  other_piece.natural[0].markers[0].map_piece = 1;
  EXPECT_TRUE(other_piece.seenPicture().is_null());
  PictureScene no_number;
  no_number.natural[0].markers[0].width = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(no_number.seenPicture().is_null());
  PictureScene no_lens;
  no_lens.lens.fx = 0.0;
  EXPECT_TRUE(no_lens.seenPicture().is_null());
}

TEST(SeenMarkers, Base64IsTheStandards) {
  EXPECT_EQ(base64Of(""), "");
  EXPECT_EQ(base64Of("f"), "Zg==");
  EXPECT_EQ(base64Of("fo"), "Zm8=");
  EXPECT_EQ(base64Of("foo"), "Zm9v");
  EXPECT_EQ(base64Of("foobar"), "Zm9vYmFy");
  EXPECT_EQ(base64Of("\xff\xfe"), "//4=");
}

preview_t previewOf(std::int64_t sequence) {
  preview_t preview{};
  preview.sequence = sequence;
  preview.width = 640;
  preview.height = 480;
  preview.jpeg = {0xff, 0xd8, 0xff};
  return preview;
}

TEST(Preview, OnlyAJpegOfAPlausibleSizeIsOne) {
  EXPECT_TRUE(isPlausible(previewOf(1)));
  preview_t wrong = previewOf(1);
  wrong.width = 0;
  EXPECT_FALSE(isPlausible(wrong));
  wrong = previewOf(1);
  wrong.jpeg = {'<', 's', 'v', 'g'};
  EXPECT_FALSE(isPlausible(wrong));
  wrong.jpeg.clear();
  EXPECT_FALSE(isPlausible(wrong));
}

TEST(Preview, ComesWithWhatWasFoundInItsOwnFrame) {
  LiveState state;
  const auto show = [&](std::int64_t sequence, int id) {
    pose_t pose{};
    pose.sequence = sequence;
    state.add(pose, 1);
    detections_t detections{};
    detections.sequence = sequence;
    detections.detections.resize(1);
    detections.detections[0].id = id;
    state.add(detections, 1);
  };
  show(4, 11);
  show(5, 12);
  show(6, 13);
  state.add(previewOf(5), 1);
  const Json json = Json::parse(state.text(Part::kPreview));
  EXPECT_EQ(json["sequence"], 5);
  EXPECT_EQ(json["image"], "data:image/jpeg;base64,/9j/");
  ASSERT_EQ(json["markers"].size(), 1U);
  EXPECT_EQ(json["markers"][0]["id"], 12);
  state.add(previewOf(9), 1);
  EXPECT_FALSE(Json::parse(state.text(Part::kPreview)).contains("markers"))
      << "no frame of it was heard of";
}

// What was found in a frame is told frames later.
TEST(Preview, PicturesAreAddedToTheImageThatIsThereAlready) {
  LiveState state;
  const PictureScene scene;
  natural_map_t map = scene.natural.at(0);
  map.piece_count = map.count = 1;
  state.add(map, 1);
  health_t health{};
  health.lens = scene.lens;
  state.add(health, 1);
  state.add(scene.pose, 1);
  state.add(scene.detections, 1);
  state.add(previewOf(5), 1);
  Json pictures = Json::parse(state.text(Part::kPreview))["pictures"];
  ASSERT_EQ(pictures.size(), 1U);
  EXPECT_FALSE(pictures[0].contains("corners"));
  const std::uint64_t version = state.version(Part::kPreview);
  natural_detections_t found{};
  found.sequence = 9;
  found.detections.resize(1);
  found.detections[0].sequence = 4;
  found.detections[0].id = 1 << 30;
  state.add(found, 1);
  EXPECT_EQ(state.version(Part::kPreview), version) << "of another frame";
  found.detections[0].sequence = 5;
  found.detections[0].p_m_c[2] = 1.0;
  found.detections[0].q_m_c[1] = 1.0;
  state.add(found, 1);
  EXPECT_GT(state.version(Part::kPreview), version);
  pictures = Json::parse(state.text(Part::kPreview))["pictures"];
  ASSERT_EQ(pictures.size(), 1U);
  expectCorners(pictures[0]["corners"], 100, 50);
  EXPECT_EQ(Json::parse(state.text(Part::kDetections))["pictures"], pictures);
}

calibration_t calibrationOfFrame(std::int64_t sequence) {
  calibration_t calibration{};
  calibration.sequence = sequence;
  calibration.advice = "Bring it there in the image: left";
  calibration.frames = 9;
  calibration.frames_with_board = 7;
  calibration.views = 3;
  calibration.columns = calibration.rows = 2;
  calibration.cells = 4;
  calibration.points_in_cell = {0, 12, 3, 1};
  calibration.count = 1;
  calibration.points_px = {{10.0F, 20.0F}};
  return calibration;
}

TEST(Calibration, IsToldWithTheImageOfItsFrame) {
  LiveState state;
  state.add(calibrationOfFrame(5), 1);
  state.add(previewOf(5), 1);
  const Json told = Json::parse(state.text(Part::kCalibration));
  EXPECT_EQ(told["advice"], "Bring it there in the image: left");
  EXPECT_EQ(told["covered"], 0.75);
  const Json board = Json::parse(state.text(Part::kPreview))["board"];
  EXPECT_EQ(board["points"], Json::parse("[[10.0, 20.0]]"));
  EXPECT_EQ(board["cells"], Json::parse("[0, 12, 3, 1]"));
  state.add(previewOf(6), 1);
  EXPECT_FALSE(Json::parse(state.text(Part::kPreview)).contains("board")) << "another frame's";
}

TEST(Calibration, IsOverWhenNothingMoreIsHeardOfIt) {
  LiveState state;
  state.add(calibrationOfFrame(5), 10'000'000'000);
  state.tick(12'000'000'000);
  EXPECT_TRUE(Json::parse(state.text(Part::kCalibration)).contains("advice"));
  const std::uint64_t before = state.version(Part::kCalibration);
  state.tick(14'000'000'000);
  EXPECT_FALSE(Json::parse(state.text(Part::kCalibration)).contains("advice"));
  EXPECT_GT(state.version(Part::kCalibration), before);
}

TEST(Calibration, CellsThatAreNoneAreNotBelieved) {
  EXPECT_TRUE(isPlausible(calibrationOfFrame(1)));
  calibration_t wrong = calibrationOfFrame(1);
  wrong.rows = 3;
  EXPECT_FALSE(isPlausible(wrong));
  wrong.rows = wrong.columns = 65'536;
  EXPECT_FALSE(isPlausible(wrong));
  wrong.rows = wrong.columns = 0;
  wrong.points_in_cell.clear();
  EXPECT_FALSE(isPlausible(wrong));
}

TEST(Body, IsToldWithThePoseOfItsFrameOnly) {
  LiveState state;
  pose_t pose{};
  pose.sequence = 1;
  pose.utime = 10;
  pose.source = pose_t::SOURCE_MARKERS;
  state.add(pose, 1);
  bot_core::pose_t body{};
  body.utime = 10;
  body.pos[0] = 3.0;
  state.add(body, 1);
  EXPECT_EQ(Json::parse(state.text(Part::kPose))["body"]["p"][0], 3.0);
  pose.sequence = 2;
  pose.utime = 20;
  state.add(pose, 1);
  EXPECT_FALSE(Json::parse(state.text(Part::kPose)).contains("body"));
}

}  // namespace
}  // namespace waymark::view
