#include "capture/log_source.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <random>
#include <string>
#include <variant>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "capture/eventlog/log_writer.h"
#include "capture/eventlog/testing_log.h"
#include "capture/recorded_image.h"
#include "tests/temporary_directory.h"

namespace waymark::capture {
namespace {

using eventlog::testing::Bytes;
using std::chrono_literals::operator""ms;

constexpr int kWidth = 40;
constexpr int kHeight = 30;

std::vector<std::uint8_t> greyOf(int frame) {
  std::vector<std::uint8_t> grey(kWidth * kHeight);
  for (std::size_t i = 0; i < grey.size(); ++i) grey[i] = static_cast<std::uint8_t>(i + 3 * frame);
  return grey;
}

FrameStamp stampOf(int frame) {
  return {.sequence = static_cast<std::uint64_t>(100 + 2 * frame),
          .monotonic_ns = 5'000'000'123 + 20'000'000 * frame,
          .utime = 1'700'000'000'000'000 + 20'000 * frame,
          .exposure_ns = 4'000'000};
}

class LogSourceTest : public ::testing::Test {
 protected:
  void add(const bot_core::image_t& image) {
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(image.getEncodedSize()));
    ASSERT_GE(image.encode(bytes.data(), 0, static_cast<int>(bytes.size())), 0);
    ASSERT_TRUE(log_->append(image.utime, "CAMERA", bytes).ok());
  }
  static bot_core::image_t image(int frame) {
    bot_core::image_t message;
    const std::vector<std::uint8_t> grey = greyOf(frame);
    fillImage(stampOf(frame), {grey.data(), kWidth, kHeight, kWidth}, {}, &message);
    return message;
  }
  std::unique_ptr<FrameSource> open(std::optional<double> fps = {}) {
    EXPECT_TRUE(log_->flush().ok());
    Result<std::unique_ptr<FrameSource>> source = openLog(file_, fps);
    EXPECT_TRUE(source.ok()) << source.error().message;
    return source.ok() ? std::move(source).value() : nullptr;
  }

  waymark::testing::TemporaryDirectory directory_;
  std::filesystem::path file_ = directory_ / "a.lcmlog";
  Result<eventlog::LogWriter> log_ = eventlog::LogWriter::create(file_);
};

FramePtr next(FrameSource& source) {
  ReadResult result = source.read(10ms);
  EXPECT_TRUE(std::holds_alternative<FramePtr>(result));
  return std::holds_alternative<FramePtr>(result) ? std::get<FramePtr>(std::move(result)) : nullptr;
}

TEST_F(LogSourceTest, FramesComeBackAsTheyWere) {
  ASSERT_TRUE(log_->append(1, "OTHER", std::vector<std::uint8_t>(50, 3)).ok());
  for (int i = 0; i < 10; ++i) add(image(i));
  const auto source = open();
  EXPECT_TRUE(isEventLog(file_));
  ASSERT_TRUE(source);
  EXPECT_EQ(source->info().width, kWidth);
  EXPECT_DOUBLE_EQ(source->info().rate_hz, 50.0);
  for (int i = 0; i < 10; ++i) {
    const FramePtr frame = next(*source);
    ASSERT_TRUE(frame);
    const FrameStamp expected = stampOf(i);
    EXPECT_EQ(frame->stamp().sequence, expected.sequence);
    EXPECT_EQ(frame->stamp().monotonic_ns, expected.monotonic_ns);
    EXPECT_EQ(frame->stamp().utime, expected.utime);
    EXPECT_EQ(frame->stamp().exposure_ns, expected.exposure_ns);
    const std::vector<std::uint8_t> grey = greyOf(i);
    EXPECT_TRUE(std::equal(grey.begin(), grey.end(), frame->image().data));
  }
  EXPECT_TRUE(std::holds_alternative<EndOfStream>(source->read(10ms)));
  EXPECT_EQ(source->damage(), "");
}

TEST_F(LogSourceTest, JpegStaysAsTheCameraMadeIt) {
  std::vector<std::uint8_t> jpeg;
  cv::imencode(".jpg", cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(77)), jpeg);
  bot_core::image_t message;
  fillImage(stampOf(0), {nullptr, kWidth, kHeight, kWidth}, jpeg, &message);
  EXPECT_EQ(message.data, jpeg);
  add(message);
  const auto source = open();
  ASSERT_TRUE(source);
  const FramePtr frame = next(*source);
  EXPECT_EQ(frame->image().at(20, 20), 77);
  EXPECT_TRUE(frame->jpeg().empty()) << "nobody asked for it";
  const auto keeping = openLog(file_, {}, /*keep_jpeg=*/true);
  ASSERT_TRUE(keeping);
  const FramePtr kept = next(**keeping);
  EXPECT_TRUE(std::ranges::equal(kept->jpeg(), jpeg));
}

// As other programs record: rows with gaps, no metadata.
TEST_F(LogSourceTest, ImagesOfOthers) {
  bot_core::image_t message = image(4);
  message.row_stride = kWidth + 8;
  message.data.assign(static_cast<std::size_t>(message.row_stride) * kHeight, 0);
  for (int y = 0; y < kHeight; ++y) {
    message.data[static_cast<std::size_t>(y * message.row_stride)] = static_cast<std::uint8_t>(y);
  }
  message.size = static_cast<std::int32_t>(message.data.size());
  message.nmetadata = 0;
  message.metadata.clear();
  add(message);
  const auto source = open();
  ASSERT_TRUE(source);
  const FramePtr frame = next(*source);
  EXPECT_EQ(frame->image().at(0, 29), 29);
  EXPECT_EQ(frame->stamp().monotonic_ns, 1000 * stampOf(4).utime);
  EXPECT_EQ(frame->stamp().sequence, 0u);
}

TEST_F(LogSourceTest, WhatCannotBeDecodedIsSkippedAndTold) {
  add(image(0));
  bot_core::image_t torn = image(1);
  torn.data.resize(100);
  torn.size = 100;
  add(torn);
  bot_core::image_t other_size = image(2);
  other_size.width = kWidth / 2;
  add(other_size);
  bot_core::image_t colour = image(3);
  colour.pixelformat = 5;
  add(colour);
  add(image(4));
  const auto source = open();
  ASSERT_TRUE(source);
  EXPECT_EQ(next(*source)->stamp().sequence, stampOf(0).sequence);
  EXPECT_EQ(next(*source)->stamp().sequence, stampOf(4).sequence);
  EXPECT_TRUE(std::holds_alternative<EndOfStream>(source->read(10ms)));
  EXPECT_EQ(source->counters().dropped_corrupt, 3u);
  EXPECT_EQ(source->damage(), file_.string() + ": 3 images cannot be decoded");
}

// No memory for pixels that cannot be there.
TEST_F(LogSourceTest, AJpegTooShortForItsSizeIsNone) {
  bot_core::image_t huge = image(0);
  huge.pixelformat = bot_core::image_t::PIXEL_FORMAT_MJPEG;
  huge.width = huge.height = 16384;
  add(huge);
  add(image(1));
  const auto source = open();
  ASSERT_TRUE(source);
  EXPECT_EQ(source->info().width, kWidth);
}

TEST_F(LogSourceTest, ARateInsteadOfTheTimes) {
  for (int i = 0; i < 2; ++i) add(image(i));
  const auto source = open(10.0);
  ASSERT_TRUE(source);
  EXPECT_EQ(next(*source)->stamp().monotonic_ns, 0);
  EXPECT_EQ(next(*source)->stamp().monotonic_ns, 100'000'000);
}

TEST_F(LogSourceTest, ARecordingGoesOnInItsNextFile) {
  file_ = directory_ / "r-0000.lcmlog";
  for (int part = 0; part < 3; ++part) {
    log_ = eventlog::LogWriter::create(directory_ / ("r-000" + std::to_string(part) + ".lcmlog"));
    ASSERT_TRUE(log_);
    for (int i = 0; i < 4; ++i) add(image(4 * part + i));
    ASSERT_TRUE(log_->flush());
  }
  const auto source = open();
  ASSERT_TRUE(source);
  for (int i = 0; i < 12; ++i) {
    const FramePtr frame = next(*source);
    ASSERT_TRUE(frame) << i;
    EXPECT_EQ(frame->stamp().sequence, stampOf(i).sequence);
  }
  EXPECT_TRUE(std::holds_alternative<EndOfStream>(source->read(10ms)));
}

TEST_F(LogSourceTest, WhateverBitsFlipItIsReadToItsEnd) {
  for (int i = 0; i < 3; ++i) add(image(i));
  std::vector<std::uint8_t> jpeg;
  cv::imencode(".jpg", cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(77)), jpeg);
  bot_core::image_t compressed;
  fillImage(stampOf(3), {nullptr, kWidth, kHeight, kWidth}, jpeg, &compressed);
  add(compressed);
  ASSERT_TRUE(log_->flush());
  const Bytes whole = eventlog::testing::readAll(file_);
  std::mt19937 random(11);
  int unreadable = 0;
  for (int round = 0; round < 2000; ++round) {
    Bytes damaged = whole;
    for (unsigned flips = 1 + random() % 8; flips > 0; --flips) {
      // Half of them in the headers of events and images.
      const std::size_t at = random() % (random() % 2 == 0 ? 100 : damaged.size());
      damaged[at] ^= static_cast<std::uint8_t>(1U << (random() % 8));
    }
    eventlog::testing::writeAll(file_, damaged);
    const auto source = openLog(file_, {});
    if (!source) {
      ++unreadable;
      continue;
    }
    int frames = 0;
    while (std::holds_alternative<FramePtr>((*source)->read(10ms))) ++frames;
    EXPECT_LE(frames, 4);
  }
  EXPECT_LT(unreadable, 200) << "one image at least is left";
}

TEST_F(LogSourceTest, WithoutImagesItIsNoSource) {
  ASSERT_TRUE(log_->append(1, "OTHER", std::vector<std::uint8_t>(50, 3)).ok());
  ASSERT_TRUE(log_->flush().ok());
  const Result<std::unique_ptr<FrameSource>> source = openLog(file_, {});
  ASSERT_FALSE(source.ok());
  EXPECT_EQ(source.error().message, file_.string() + ": the log holds no image that can be read");
  EXPECT_FALSE(isEventLog("/dev/null"));
}

}  // namespace
}  // namespace waymark::capture
