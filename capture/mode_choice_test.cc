#include "capture/mode_choice.h"

#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <linux/videodev2.h>

#include "capture/pixel_format.h"

namespace waymark::capture {
namespace {

OfferedMode size(std::uint32_t fourcc, int width, int height, std::vector<double> rates_hz) {
  return {.fourcc = fourcc,
          .min_width = width,
          .max_width = width,
          .min_height = height,
          .max_height = height,
          .rates_hz = std::move(rates_hz)};
}

// A usual webcam: fast only when it compresses.
std::vector<OfferedMode> webcam() {
  return {
      size(V4L2_PIX_FMT_MJPEG, 1280, 720, {60.0, 30.0}),
      size(V4L2_PIX_FMT_MJPEG, 640, 480, {120.0, 30.0}), size(V4L2_PIX_FMT_YUYV, 1280, 720, {10.0}),
      size(V4L2_PIX_FMT_YUYV, 640, 480, {30.0, 15.0}), size(V4L2_PIX_FMT_H264, 1920, 1080, {60.0})};
}

CameraOptions ask(int width, int height, double rate_hz = 0.0, std::string format = "") {
  CameraOptions options;
  options.format = std::move(format);
  options.width = width;
  options.height = height;
  options.rate_hz = rate_hz;
  return options;
}

ChosenMode choose(const std::vector<OfferedMode>& offered, const CameraOptions& asked) {
  const Result<ChosenMode> chosen = chooseMode(offered, asked);
  EXPECT_TRUE(chosen.ok()) << chosen.error().message;
  return chosen.ok() ? chosen.value() : ChosenMode{};
}

std::string rejection(const std::vector<OfferedMode>& offered, const CameraOptions& asked) {
  const Result<ChosenMode> chosen = chooseMode(offered, asked);
  return chosen.ok() ? "" : chosen.error().message;
}

void expectMode(const ChosenMode& mode, std::uint32_t fourcc, int width, double rate_hz) {
  EXPECT_EQ(fourccText(mode.fourcc), fourccText(fourcc));
  EXPECT_EQ(mode.width, width);
  EXPECT_DOUBLE_EQ(mode.rate_hz, rate_hz);
}

TEST(ModeChoice, TheCheapestFormatThatReachesTheRate) {
  expectMode(choose(webcam(), ask(640, 480, 30.0)), V4L2_PIX_FMT_YUYV, 640, 30.0);
  expectMode(choose(webcam(), ask(640, 480, 100.0)), V4L2_PIX_FMT_MJPEG, 640, 120.0);
  expectMode(choose(webcam(), ask(1280, 720, 30.0)), V4L2_PIX_FMT_MJPEG, 1280, 30.0);
}

TEST(ModeChoice, WithoutARateAsFastAsItGoes) {
  expectMode(choose(webcam(), ask(640, 480)), V4L2_PIX_FMT_MJPEG, 640, 120.0);
}

TEST(ModeChoice, WithoutASizeTheLargestThatIsFast) {
  expectMode(choose(webcam(), {}), V4L2_PIX_FMT_MJPEG, 1280, 60.0);
  expectMode(choose(webcam(), ask(0, 0, 100.0)), V4L2_PIX_FMT_MJPEG, 640, 120.0);
}

TEST(ModeChoice, AFormatAskedForIsTaken) {
  const ChosenMode mode = choose(webcam(), ask(1280, 720, 30.0, "yuyv"));
  expectMode(mode, V4L2_PIX_FMT_YUYV, 1280, 10.0);
  ASSERT_EQ(mode.warnings.size(), 1U);
  EXPECT_EQ(mode.warnings[0], "asked for 30 Hz, it gives 10 Hz at 1280x720");
}

TEST(ModeChoice, ThirtyIsNtscThirty) {
  const double ntsc = 30000.0 / 1001.0;
  const ChosenMode mode =
      choose({size(V4L2_PIX_FMT_GREY, 640, 480, {60.0, ntsc})}, ask(640, 480, 30.0));
  expectMode(mode, V4L2_PIX_FMT_GREY, 640, ntsc);
  EXPECT_TRUE(mode.warnings.empty());
}

TEST(ModeChoice, RangesOfSizesAndUnknownRates) {
  const std::vector<OfferedMode> offered = {{.fourcc = V4L2_PIX_FMT_NV12,
                                             .min_width = 16,
                                             .max_width = 1920,
                                             .width_step = 2,
                                             .min_height = 16,
                                             .max_height = 1080,
                                             .height_step = 2,
                                             .rates_hz = {}}};
  expectMode(choose(offered, ask(640, 480, 30.0)), V4L2_PIX_FMT_NV12, 640, 0.0);
  EXPECT_EQ(rejection(offered, ask(641, 480)),
            "does not offer 641x480; it offers NV12 16x16 to 1920x1080 in steps of 2x2 pixels");
}

TEST(ModeChoice, WhatIsNotThereIsRejectedWithWhatIs) {
  EXPECT_EQ(rejection(webcam(), ask(800, 600, 0.0, "YUYV")),
            "does not offer 800x600; it offers YUYV 1280x720 at 10 Hz; YUYV 640x480 at 30, 15 Hz");
  EXPECT_EQ(rejection(webcam(), ask(0, 0, 0.0, "GREY")),
            "does not offer the format GREY; it offers H264, MJPG, YUYV");
  EXPECT_TRUE(rejection({size(V4L2_PIX_FMT_H264, 640, 480, {30.0})}, {})
                  .starts_with("offers no format that can be read (GREY, NV12"));
}

TEST(PixelFormat, NamesAreThoseThatUsersType) {
  EXPECT_EQ(readFourcc("mjpeg"), std::uint32_t{V4L2_PIX_FMT_MJPEG});
  EXPECT_EQ(readFourcc("Y10"), std::uint32_t{V4L2_PIX_FMT_Y10});
  EXPECT_EQ(readFourcc("H264"), std::nullopt);
  EXPECT_EQ(fourccText(V4L2_PIX_FMT_Y16), "Y16");
}

}  // namespace
}  // namespace waymark::capture
