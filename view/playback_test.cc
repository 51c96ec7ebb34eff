#include "view/playback.h"

#include <fstream>
#include <vector>

#include <bot_core/image_t.hpp>
#include <gtest/gtest.h>

#include "capture/eventlog/log_writer.h"
#include "tests/temporary_directory.h"
#include <waymark/detections_t.hpp>
#include <waymark/pose_t.hpp>

namespace waymark::view {
namespace {

using io::Json;

constexpr std::int64_t kBegin_us = 1'700'000'000'000'000;
constexpr std::int64_t kTick_ns = 1'000'000'000;

// Ten seconds at 10 Hz: images, poses and detections; a map in the first of each five seconds,
// with a natural marker, which is found a second later.
class PlaybackTest : public ::testing::Test {
 protected:
  PlaybackTest() {
    auto writer = eventlog::LogWriter::create(file_);
    for (int i = 0; i < 100; ++i) {
      const std::int64_t utime = kBegin_us + 100'000 * i;
      bot_core::image_t image{};
      image.utime = utime;
      image.width = image.row_stride = 8;
      image.height = 4;
      image.pixelformat = bot_core::image_t::PIXEL_FORMAT_GRAY;
      image.data.assign(32, 100);
      image.size = 32;
      append(*writer, utime, "CAMERA", image);
      pose_t pose{};
      pose.sequence = i;
      pose.status = pose_t::STATUS_TRACKING;
      pose.source = pose_t::SOURCE_MARKERS;
      pose.p_w_c[0] = 0.1 * i;
      append(*writer, utime + 1000, "WAYMARK_POSE", pose);
      detections_t detections{};
      detections.sequence = i;
      append(*writer, utime + 2000, "WAYMARK_DETECTIONS", detections);
      if (i % 50 == 10) {
        natural_detections_t found{};
        found.sequence = i;
        found.count = 1;
        found.detections.resize(1);
        found.detections[0].sequence = i - 2;
        append(*writer, utime + 3000, "WAYMARK_NATURAL", found);
      }
      if (i % 50 != 0) continue;
      health_t health{};
      health.lens.width = health.lens.height = 100;
      health.lens.fx = health.lens.fy = 100.0;
      health.lens.cx = health.lens.cy = 50.0;
      append(*writer, utime + 3000, "WAYMARK_HEALTH", health);
      map_t map{};
      map.piece_count = 1;
      map.revision = 1;
      map.count = 1;
      map.markers.resize(1);
      append(*writer, utime + 3000, "WAYMARK_MAP", map);
      natural_map_t natural{};
      natural.piece_count = natural.count = 1;
      natural.revision = 1;
      natural.markers.resize(1);
      natural.markers[0].width = 1.0;
      natural.markers[0].p_w_m[2] = 20.0;
      natural.markers[0].q_w_m[1] = 1.0;
      append(*writer, utime + 3000, "WAYMARK_NATURAL_MAP", natural);
    }
    EXPECT_TRUE(writer->flush());
  }
  template <typename Message>
  void append(eventlog::LogWriter& writer, std::int64_t utime, const char* channel,
              const Message& message) const {
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    EXPECT_TRUE(writer.append(utime, channel, bytes));
  }
  [[nodiscard]] Playback open() const {
    auto playback = Playback::open(file_, "WAYMARK_", "POSE");
    EXPECT_TRUE(playback) << playback.error().message;
    return std::move(playback).value();
  }
  Json part(Part which) { return Json::parse(state_.text(which)); }

  testing::TemporaryDirectory directory_;
  const std::filesystem::path file_ = directory_ / "recording.lcmlog";
  LiveState state_;
};

TEST_F(PlaybackTest, ShowsWhatWasRecordedWhenItsTimeComes) {
  Playback playback = open();
  playback.tick(5 * kTick_ns, &state_);
  EXPECT_FALSE(part(Part::kPose).contains("sequence"));
  playback.tick(6 * kTick_ns, &state_);
  EXPECT_EQ(part(Part::kPose)["sequence"], 9);
  EXPECT_EQ(part(Part::kMap)["markers"].size(), 1U);
  const Json status = part(Part::kPlayback);
  EXPECT_NEAR(status["now_s"], 1.0, 1e-6);
  EXPECT_NEAR(status["length_s"], 9.902, 1e-6);
  EXPECT_EQ(status["playing"], true);
  EXPECT_EQ(status["images_only"], false);
}

TEST_F(PlaybackTest, AnImageComesWithWhatWasFoundInIt) {
  Playback playback = open();
  playback.tick(kTick_ns, &state_);
  playback.tick(2 * kTick_ns, &state_);
  playback.tick(2 * kTick_ns + kTick_ns / 30, &state_);
  const Json preview = part(Part::kPreview);
  EXPECT_TRUE(preview["image"].get<std::string>().starts_with("data:image/jpeg;base64,/9j/"));
  EXPECT_EQ(preview["width"], 8);
  EXPECT_TRUE(preview.contains("markers"));
}

TEST_F(PlaybackTest, NaturalMarkersComeWithMapAndFrames) {
  Playback playback = open();
  playback.tick(kTick_ns, &state_);
  playback.tick(kTick_ns + kTick_ns / 2, &state_);
  EXPECT_EQ(part(Part::kMap)["natural"].size(), 1U);
  ASSERT_EQ(part(Part::kDetections)["pictures"].size(), 1U);
  EXPECT_EQ(part(Part::kDetections)["pictures"][0]["lately"], false);
  playback.tick(2 * kTick_ns + kTick_ns / 2, &state_);
  EXPECT_EQ(part(Part::kDetections)["pictures"][0]["lately"], true);
}

TEST_F(PlaybackTest, PausesAndGoesToAnyTime) {
  Playback playback = open();
  playback.tick(kTick_ns, &state_);
  EXPECT_EQ(playback.command(R"({"command":"pause"})")["ok"], true);
  playback.tick(4 * kTick_ns, &state_);
  EXPECT_NEAR(part(Part::kPlayback)["now_s"], 0.0, 1e-6);
  EXPECT_EQ(playback.command(R"({"command":"seek","to_s":8.05})")["ok"], true);
  playback.tick(5 * kTick_ns, &state_);
  EXPECT_EQ(part(Part::kPose)["sequence"], 80);
  EXPECT_EQ(part(Part::kMap)["markers"].size(), 1U) << "told before";
  EXPECT_EQ(playback.command(R"({"command":"seek","to_s":2.05})")["ok"], true);
  playback.tick(6 * kTick_ns, &state_);
  EXPECT_EQ(part(Part::kPose)["sequence"], 20);
  EXPECT_EQ(playback.command(R"({"command":"play"})")["ok"], true);
  playback.tick(60 * kTick_ns, &state_);
  EXPECT_EQ(part(Part::kPose)["sequence"], 99);
  EXPECT_EQ(part(Part::kPlayback)["playing"], false) << "it is over";
  state_.tick(60 * kTick_ns);
  EXPECT_EQ(part(Part::kLink)["alive"], true);
}

TEST_F(PlaybackTest, RefusesNonsense) {
  Playback playback = open();
  for (const char* wrong :
       {"", "[]", R"({"command":"reset"})", R"({"command":"seek"})",
        R"({"command":"seek","to_s":-1})", R"({"command":"seek","to_s":1e9})"}) {
    EXPECT_EQ(playback.command(wrong)["ok"], false) << wrong;
  }
  std::ofstream(directory_ / "noise") << "this is no log";
  EXPECT_FALSE(Playback::open(directory_ / "noise", "WAYMARK_", "POSE"));
}

}  // namespace
}  // namespace waymark::view
