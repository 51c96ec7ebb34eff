#include "view/live_state.h"

#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "io/calibrations/calibration_file.h"

namespace waymark::view {
namespace {

using io::Json;

constexpr std::int64_t kSecond_ns = 1'000'000'000;

pose_t poseOf(std::int64_t sequence, double x) {
  pose_t pose{};
  pose.sequence = sequence;
  pose.status = pose_t::STATUS_TRACKING;
  pose.source = pose_t::SOURCE_MARKERS;
  pose.p_w_c[0] = x;
  pose.q_w_c[0] = 1.0;
  pose.covariance[7] = 4e-6;
  pose.latency_ns = 2'500'000;
  return pose;
}

map_t mapPiece(std::int64_t revision, int piece, int pieces, int id) {
  map_t map{};
  map.revision = revision;
  map.piece = piece;
  map.piece_count = pieces;
  map.dictionary = "ARUCO_MIP_36h12";
  map.markers.resize(1);
  map.markers[0].id = id;
  map.markers[0].size = 0.1;
  map.count = 1;
  return map;
}

natural_map_t naturalPart(std::int64_t revision, int piece, int pieces, const char* name) {
  natural_map_t map{};
  map.revision = revision;
  map.piece = piece;
  map.piece_count = pieces;
  map.markers.resize(1);
  map.markers[0].name = name;
  map.markers[0].width = 0.6;
  map.markers[0].height = 0.4;
  map.markers[0].map_piece = 2;
  map.markers[0].covariance[7] = 9e-6;
  map.count = 1;
  return map;
}

health_t healthOf(std::int64_t uptime_ns, std::int64_t drops) {
  health_t health{};
  health.uptime_ns = uptime_ns;
  health.version = "0.1.0";
  health.counters = {{"dropped.queue", drops}, {"camera.frames", 5}};
  health.counter_count = 2;
  return health;
}

Json parsed(const LiveState& state, Part part) { return Json::parse(state.text(part)); }

TEST(LiveState, ADaemonThatSaysNothingIsGone) {
  LiveState state;
  state.tick(kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kLink)["alive"], false);
  state.add(poseOf(1, 0.0), 10 * kSecond_ns);
  const std::uint64_t before = state.version(Part::kLink);
  state.tick(10 * kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kLink)["alive"], true);
  EXPECT_GT(state.version(Part::kLink), before);
  state.tick(14 * kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kLink)["alive"], false);
  state.setFault("no multicast route");
  EXPECT_EQ(parsed(state, Part::kLink)["fault"], "no multicast route");
}

TEST(LiveState, PosesWithTheirLatenciesAndGaps) {
  LiveState state;
  for (const int sequence : {1, 2, 5}) state.add(poseOf(sequence, 0.1 * sequence), kSecond_ns);
  const Json pose = parsed(state, Part::kPose);
  EXPECT_EQ(pose["status"], "tracking");
  EXPECT_EQ(pose["p"], (Json{0.5, 0.0, 0.0}));
  EXPECT_EQ(pose["missing"], 2);
  EXPECT_EQ(pose["frames"], 3);
  EXPECT_DOUBLE_EQ(pose["sigma_m"].get<double>(), 2e-3);
  EXPECT_EQ(pose["latency_histogram"]["counts"][3], 3) << "up to 3 ms";
  // Older than a minute it is forgotten.
  state.tick(40 * kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kPose)["latency_histogram"]["counts"][3], 3);
  state.tick(80 * kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kPose)["latency_histogram"]["counts"][3], 0);
  EXPECT_EQ(Json::parse(state.trailText())["points"].size(), 3U);
}

// A page that is slow, or was not ready, gets what it has missed with the next pose.
TEST(LiveState, APoseBringsTheEndOfTheTrail) {
  LiveState state;
  for (int i = 0; i < 50; ++i) state.add(poseOf(i, 0.123456 * i), kSecond_ns);
  const Json way = parsed(state, Part::kPose)["way"];
  ASSERT_EQ(way.size(), 32U);
  EXPECT_EQ(way[0], (Json{18, 2.2222, 0.0, 0.0, 1, 0}));
  EXPECT_EQ(way[31][0], 49);
  EXPECT_EQ(Json::parse(state.trailText())["points"][49], way[31]);
  state.add(poseOf(50, 0.123456 * 49), kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kPose)["way"], way) << "it stands still";
}

TEST(LiveState, WithoutAPoseTheReasonIsTold) {
  LiveState state;
  pose_t none{};
  none.status = pose_t::STATUS_NO_CAMERA;
  none.reason = "/dev/video0: unplugged \xff";
  state.add(none, kSecond_ns);
  const Json pose = parsed(state, Part::kPose);
  EXPECT_EQ(pose["status"], "no camera");
  EXPECT_TRUE(pose["reason"].get<std::string>().starts_with("/dev/video0: unplugged"));
  EXPECT_FALSE(pose.contains("p"));
  EXPECT_EQ(pose["frames"], 0);
}

TEST(LiveState, AMapIsThereWhenAllItsPiecesAre) {
  LiveState state;
  state.add(mapPiece(3, 0, 2, 7), kSecond_ns);
  EXPECT_TRUE(parsed(state, Part::kMap)["markers"].empty());
  state.add(mapPiece(3, 1, 2, 9), kSecond_ns);
  Json map = parsed(state, Part::kMap);
  ASSERT_EQ(map["markers"].size(), 2U);
  EXPECT_EQ(map["markers"][0]["id"], 7);
  EXPECT_EQ(map["markers"][0]["cells"].get<std::string>().size(), 36U);
  EXPECT_EQ(map["side"], 6);
  // The same again is no news; a new one is, once it is whole.
  const std::uint64_t version = state.version(Part::kMap);
  state.add(mapPiece(3, 0, 2, 7), kSecond_ns);
  state.add(mapPiece(4, 0, 2, 1), kSecond_ns);
  EXPECT_EQ(state.version(Part::kMap), version);
  state.add(mapPiece(5, 0, 1, 2), kSecond_ns);
  map = parsed(state, Part::kMap);
  ASSERT_EQ(map["markers"].size(), 1U);
  EXPECT_EQ(map["markers"][0]["id"], 2);
}

TEST(LiveState, NaturalMarkersAreAPartOfTheMap) {
  LiveState state;
  EXPECT_TRUE(parsed(state, Part::kMap)["natural"].empty());
  state.add(mapPiece(3, 0, 1, 7), kSecond_ns);
  state.add(naturalPart(3, 0, 2, "poster"), kSecond_ns);
  EXPECT_TRUE(parsed(state, Part::kMap)["natural"].empty()) << "not all of them are there";
  const std::uint64_t version = state.version(Part::kMap);
  state.add(naturalPart(3, 1, 2, "door \xff"), kSecond_ns);
  EXPECT_GT(state.version(Part::kMap), version);
  const Json natural = parsed(state, Part::kMap)["natural"];
  ASSERT_EQ(natural.size(), 2U);
  EXPECT_EQ(natural[0]["name"], "poster");
  EXPECT_EQ(natural[0]["width"], 0.6);
  EXPECT_EQ(natural[0]["height"], 0.4);
  EXPECT_EQ(natural[0]["piece"], 2);
  EXPECT_NEAR(natural[0]["sigma_m"], 3e-3, 1e-12);
  state.add(naturalPart(4, 5, 2, "none"), kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kLink)["malformed"], 1);
  // Of a map that comes again without them there are none any more.
  state.add(mapPiece(4, 0, 1, 7), kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kMap)["natural"].size(), 2U) << "they may be on their way";
  state.add(mapPiece(4, 0, 1, 7), kSecond_ns);
  EXPECT_TRUE(parsed(state, Part::kMap)["natural"].empty());
}

TEST(LiveState, AnotherStartOfTheDaemonForgetsTheOneBefore) {
  LiveState state;
  state.add(mapPiece(5, 0, 1, 2), kSecond_ns);
  for (int i = 100; i < 103; ++i) state.add(poseOf(i, i), kSecond_ns);
  state.add(poseOf(0, 0.0), kSecond_ns);
  EXPECT_TRUE(parsed(state, Part::kMap)["markers"].empty());
  EXPECT_EQ(Json::parse(state.trailText())["points"].size(), 1U);
  EXPECT_EQ(parsed(state, Part::kPose)["missing"], 0);
  // A map of the same revision is another one.
  state.add(mapPiece(5, 0, 1, 3), kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kMap)["markers"][0]["id"], 3);
}

TEST(LiveState, AnotherPieceOfTheMapIsAnotherWorld) {
  LiveState state;
  for (int i = 1; i < 4; ++i) state.add(poseOf(i, i), kSecond_ns);
  pose_t elsewhere = poseOf(4, 0.0);
  elsewhere.map_piece = 2;
  state.add(elsewhere, kSecond_ns);
  EXPECT_EQ(Json::parse(state.trailText())["points"].size(), 1U);
  EXPECT_EQ(parsed(state, Part::kPose)["piece"], 2);
  map_t map = mapPiece(1, 0, 1, 7);
  map.markers[0].map_piece = 2;
  state.add(map, kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kMap)["markers"][0]["piece"], 2);
}

TEST(LiveState, CountersThatHaveGrown) {
  LiveState state;
  state.add(healthOf(kSecond_ns, 4), kSecond_ns);
  EXPECT_TRUE(parsed(state, Part::kHealth)["grown"].empty());
  state.add(healthOf(2 * kSecond_ns, 6), kSecond_ns);
  EXPECT_EQ(parsed(state, Part::kHealth)["grown"], (Json{{"dropped.queue", 2}}));
}

TEST(LiveState, WhatNoDaemonSendsDoesNoHarm) {
  LiveState state;
  for (const auto& [piece, pieces] : {std::pair(-1, 1), {0, 0}, {1, 1}, {0, 2'000'000'000}}) {
    state.add(mapPiece(1, piece, pieces, 1), kSecond_ns);
  }
  pose_t odd = poseOf(1, std::numeric_limits<double>::quiet_NaN());
  odd.latency_ns = std::numeric_limits<std::int64_t>::min();
  odd.covariance[0] = -1.0;
  state.add(odd, kSecond_ns);
  odd.sequence = std::numeric_limits<std::int64_t>::max();
  state.add(odd, kSecond_ns);
  odd.sequence = std::numeric_limits<std::int64_t>::min();
  state.add(odd, kSecond_ns);
  map_t map = mapPiece(2, 0, 1, -5);
  map.dictionary = "\xff\"";
  state.add(map, kSecond_ns);
  for (const Part part :
       {Part::kLink, Part::kPose, Part::kMap, Part::kHealth, Part::kDetections, Part::kControl}) {
    EXPECT_TRUE(Json::accept(state.text(part)));
  }
  EXPECT_TRUE(Json::accept(state.stateText()));
  EXPECT_EQ(parsed(state, Part::kLink)["malformed"], 4);
}

TEST(LiveState, MetricsArePrometheusText) {
  LiveState state;
  state.add(poseOf(1, 0.0), kSecond_ns);
  health_t health = healthOf(kSecond_ns, 4);
  health.counters[1].name = "odd\"\\\n";
  state.add(health, kSecond_ns);
  state.tick(kSecond_ns);
  const std::string text = state.metricsText();
  EXPECT_NE(text.find("waymark_up 1\n"), std::string::npos);
  EXPECT_NE(text.find("waymark_status{status=\"tracking\"} 1\n"), std::string::npos);
  EXPECT_NE(text.find("waymark_events_total{name=\"dropped.queue\"} 4\n"), std::string::npos);
  EXPECT_NE(text.find("{name=\"odd\\\"\\\\\\n\"} 5\n"), std::string::npos) << text;
}

TEST(LiveState, TheLensInUseIsACalibrationFile) {
  LiveState state;
  EXPECT_FALSE(state.calibrationFile());
  health_t health = healthOf(kSecond_ns, 0);
  state.add(health, kSecond_ns);
  EXPECT_FALSE(state.calibrationFile()) << "no frame has come yet";
  health.lens.width = 640;
  health.lens.height = 480;
  health.lens.fx = 512.5;
  health.lens.fy = 511.5;
  health.lens.cx = 320.0;
  health.lens.cy = 240.0;
  health.lens.distortion[0] = -0.1;
  state.add(health, 2 * kSecond_ns);
  ASSERT_TRUE(state.calibrationFile());
  const auto read = io::parseCalibration(*state.calibrationFile(), "calib.yml");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->fx, 512.5);
  EXPECT_EQ(read->distortion[0], -0.1);
}

}  // namespace
}  // namespace waymark::view
