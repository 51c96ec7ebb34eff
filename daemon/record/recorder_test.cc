#include "daemon/record/recorder.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "capture/eventlog/log_reader.h"
#include "capture/jpeg_decoder.h"
#include "capture/recorded_image.h"
#include "daemon/record/recorder_setup.h"
#include "tests/temporary_directory.h"
#include <waymark/file_t.hpp>

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;
using capture::RecordedFile;
using std::chrono::milliseconds;
using std::chrono::steady_clock;
using Bytes = std::vector<std::uint8_t>;

constexpr int kWidth = 40;
constexpr int kHeight = 30;

struct Recorded {
  std::vector<std::string> channels;  // in the log's order
  std::vector<bot_core::image_t> images;
  std::vector<capture::FrameStamp> stamps;
  std::vector<Bytes> messages;  // on the channel "POSE"
  std::vector<file_t> files;
};

class RecorderTest : public ::testing::Test {
 protected:
  RecorderTest() : pool_(kWidth, kHeight, 2) {
    options_.log.directory = directory_ / "logs";
    options_.log.keep_free_bytes = 0;
    options_.frame_buffer_bytes = std::size_t{1} << 20U;
    options_.message_buffer_bytes = std::size_t{1} << 16U;
  }
  ~RecorderTest() override { finish(); }

  Recorder& make() {
    recorder_ = std::make_unique<Recorder>(
        options_, std::vector<RecordedFile>{{"configuration", "waymarkd.toml", "a = 1\n"}}, log_);
    return *recorder_;
  }
  void run() {
    thread_ = std::thread([this] { recorder_->run(); });
  }
  void finish() {
    if (!thread_.joinable()) return;
    recorder_->requestStop();
    thread_.join();
  }

  // Of its own brightness.
  capture::FramePtr frame(std::uint64_t sequence) {
    capture::FramePtr frame = pool_.acquire();
    std::fill_n(frame->pixels(), kWidth * kHeight, static_cast<std::uint8_t>(sequence % 251));
    frame->setStamp({.sequence = sequence,
                     .monotonic_ns = 1'000'000 * static_cast<std::int64_t>(sequence),
                     .utime = 1'700'000'000'000'000 + 1000 * static_cast<std::int64_t>(sequence),
                     .exposure_ns = 5});
    return frame;
  }

  [[nodiscard]] std::map<std::string, std::uint64_t> counters() const {
    std::map<std::string, std::uint64_t> all;
    recorder_->reportCounters([&](const char* name, std::uint64_t value) { all[name] = value; });
    return all;
  }
  [[nodiscard]] static bool eventually(const std::function<bool()>& holds) {
    const auto until = steady_clock::now() + milliseconds(10'000);
    while (steady_clock::now() < until) {
      if (holds()) return true;
      std::this_thread::sleep_for(milliseconds(2));
    }
    return false;
  }

  [[nodiscard]] std::vector<fs::path> files() const {
    std::vector<fs::path> all;
    for (const auto& entry : fs::directory_iterator(options_.log.directory)) {
      all.push_back(entry.path());
    }
    std::ranges::sort(all);
    return all;
  }
  [[nodiscard]] static Recorded read(const fs::path& file) {
    Recorded result;
    auto reader = eventlog::LogReader::open(file);
    EXPECT_TRUE(reader) << reader.error().message;
    for (;;) {
      const auto event = reader->next();
      EXPECT_TRUE(event);
      if (!event || !*event) break;
      const eventlog::Event& e = **event;
      result.channels.emplace_back(e.channel);
      if (e.channel == "CAMERA") {
        bot_core::image_t image;
        capture::FrameStamp stamp;
        EXPECT_TRUE(capture::readImage(e.data, 0, &image, &stamp));
        EXPECT_EQ(e.utime, stamp.utime);
        result.images.push_back(image);
        result.stamps.push_back(stamp);
      } else if (e.channel == RecordedFile::kChannel) {
        file_t message;
        EXPECT_GT(message.decode(e.data.data(), 0, static_cast<int>(e.data.size())), 0);
        result.files.push_back(message);
      } else {
        result.messages.emplace_back(e.data.begin(), e.data.end());
      }
    }
    EXPECT_EQ(reader->damages(), 0U);
    return result;
  }

  testing::TemporaryDirectory directory_;
  capture::FramePool pool_;
  const Log log_{LogLevel::kError, false};
  RecorderOptions options_;
  std::unique_ptr<Recorder> recorder_;
  std::thread thread_;
};

TEST_F(RecorderTest, FramesAndMessagesComeBackAsTheyWere) {
  Recorder& recorder = make();
  run();
  for (std::uint64_t i = 0; i < 200; ++i) {
    recorder.addFrame(*frame(i));
    const Bytes message(i + 1, static_cast<std::uint8_t>(i));
    recorder.addMessage("POSE", message, static_cast<std::int64_t>(i));
    std::this_thread::sleep_for(milliseconds(1));
  }
  finish();
  ASSERT_EQ(files().size(), 1U);
  const Recorded recorded = read(files()[0]);
  ASSERT_EQ(recorded.files.size(), 1U);
  EXPECT_EQ(recorded.channels.front(), RecordedFile::kChannel);
  EXPECT_EQ(recorded.files[0].purpose, "configuration");
  EXPECT_EQ(std::string(recorded.files[0].data.begin(), recorded.files[0].data.end()), "a = 1\n");
  ASSERT_EQ(recorded.images.size(), 200U);
  ASSERT_EQ(recorded.messages.size(), 200U);
  for (std::uint64_t i = 0; i < 200; ++i) {
    EXPECT_EQ(recorded.stamps[i].sequence, i);
    EXPECT_EQ(recorded.stamps[i].monotonic_ns, 1'000'000 * static_cast<std::int64_t>(i));
    EXPECT_EQ(recorded.images[i].pixelformat, bot_core::image_t::PIXEL_FORMAT_GRAY);
    EXPECT_EQ(recorded.images[i].data,
              Bytes(std::size_t{kWidth} * kHeight, static_cast<std::uint8_t>(i % 251)));
    EXPECT_EQ(recorded.messages[i], Bytes(i + 1, static_cast<std::uint8_t>(i)));
  }
  EXPECT_EQ(counters()["recorder.events"], 400U);
  EXPECT_EQ(counters()["recorder.lost_frames"], 0U);
}

TEST_F(RecorderTest, TheCamerasOwnPicturesStayUntouched) {
  Recorder& recorder = make();
  const Bytes jpeg{0xff, 0xd8, 1, 2, 3, 0xff, 0xd9};
  const capture::FramePtr compressed = frame(1);
  compressed->keepJpeg(jpeg);
  recorder.addFrame(*compressed);
  run();
  finish();
  const Recorded recorded = read(files().at(0));
  ASSERT_EQ(recorded.images.size(), 1U);
  EXPECT_EQ(recorded.images[0].pixelformat, bot_core::image_t::PIXEL_FORMAT_MJPEG);
  EXPECT_EQ(recorded.images[0].data, jpeg);
  EXPECT_EQ(recorded.images[0].width, kWidth);
}

TEST_F(RecorderTest, GreyPicturesAreCompressedWhenAsked) {
  options_.jpeg_quality = 90;
  Recorder& recorder = make();
  recorder.addFrame(*frame(77));
  run();
  finish();
  const Recorded recorded = read(files().at(0));
  ASSERT_EQ(recorded.images.size(), 1U);
  EXPECT_EQ(recorded.images[0].pixelformat, bot_core::image_t::PIXEL_FORMAT_MJPEG);
  Bytes grey(std::size_t{kWidth} * kHeight);
  capture::JpegDecoder decoder;
  ASSERT_FALSE(decoder.decode(recorded.images[0].data, kWidth, kHeight, grey.data()));
  EXPECT_NEAR(grey[100], 77, 2);
}

TEST_F(RecorderTest, StartsAndStopsWhenAsked) {
  options_.at_start = false;
  Recorder& recorder = make();
  run();
  recorder.addFrame(*frame(1));
  EXPECT_EQ(recorder.report().state, RecorderState::kOff);
  EXPECT_FALSE(fs::exists(options_.log.directory)) << "nothing is made unasked";
  for (std::uint64_t round = 1; round <= 2; ++round) {
    recorder.start();
    ASSERT_TRUE(eventually([&] { return recorder.report().state == RecorderState::kRecording; }));
    recorder.addFrame(*frame(10 * round));
    ASSERT_TRUE(eventually([&] { return counters()["recorder.events"] == round; }));
    EXPECT_NE(recorder.report().file, "");
    recorder.stop();
    ASSERT_TRUE(eventually([&] { return recorder.report().state == RecorderState::kOff; }));
  }
  recorder.addFrame(*frame(30));
  finish();
  ASSERT_EQ(files().size(), 2U) << "one for each time";
  for (std::size_t i = 0; i < 2; ++i) {
    const Recorded recorded = read(files()[i]);
    EXPECT_EQ(recorded.files.size(), 1U);
    ASSERT_EQ(recorded.stamps.size(), 1U);
    EXPECT_EQ(recorded.stamps[0].sequence, 10 * (i + 1));
  }
}

TEST_F(RecorderTest, WhatFindsNoRoomIsCountedAndNobodyWaits) {
  options_.frame_buffer_bytes = std::size_t{10} * kWidth * kHeight;
  options_.message_buffer_bytes = 1000;
  Recorder& recorder = make();  // whose thread does not run
  for (std::uint64_t i = 0; i < 30; ++i) {
    recorder.addFrame(*frame(i));
    recorder.addMessage("POSE", Bytes(100), 0);
  }
  run();
  finish();
  const Recorded recorded = read(files().at(0));
  EXPECT_GT(counters()["recorder.lost_frames"], 15U);
  EXPECT_EQ(counters()["recorder.lost_frames"] + recorded.images.size(), 30U);
  EXPECT_GT(counters()["recorder.lost_messages"], 15U);
  EXPECT_EQ(counters()["recorder.lost_messages"] + recorded.messages.size(), 30U);
}

TEST_F(RecorderTest, ADirectoryThatCannotBeUsedIsAPause) {
  testing::TemporaryDirectory other;
  options_.log.directory = other / "file" / "logs";
  fs::create_directories(other / "somewhere");
  { std::ofstream(other / "file") << "in the way"; }
  Recorder& recorder = make();
  run();
  ASSERT_TRUE(eventually([&] { return recorder.report().state == RecorderState::kPaused; }));
  EXPECT_NE(recorder.report().reason.find("file/logs"), std::string::npos)
      << recorder.report().reason;
  recorder.addFrame(*frame(1));
  ASSERT_TRUE(eventually([&] { return counters()["recorder.lost_paused"] == 1; }));
  finish();
}

TEST_F(RecorderTest, EachFileBeginsWithWhatItNeeds) {
  options_.log.file_bytes = 20'000;
  Recorder& recorder = make();
  run();
  for (std::uint64_t i = 0; i < 100; ++i) {
    recorder.addFrame(*frame(i));
    std::this_thread::sleep_for(milliseconds(1));
  }
  finish();
  std::size_t images = 0;
  ASSERT_GT(files().size(), 4U);
  for (const fs::path& file : files()) {
    const Recorded recorded = read(file);
    ASSERT_EQ(recorded.files.size(), 1U);
    EXPECT_EQ(recorded.channels.front(), RecordedFile::kChannel);
    images += recorded.images.size();
  }
  EXPECT_EQ(images, 100U);
}

TEST_F(RecorderTest, ABufferOfTheLeastSizeTakesAFrameWhereverTheLastOneEnded) {
  const std::size_t least = Recorder::leastBufferBytes(kWidth, kHeight);
  EXPECT_LT(least, std::size_t{4} * kWidth * kHeight);
  // It stands in the middle when the second frame comes.
  options_.frame_buffer_bytes = least;
  make();
  run();
  for (std::uint64_t i = 0; i < 5; ++i) {
    recorder_->addFrame(*frame(i));
    const auto written = [&] { return counters()["recorder.events"] > i; };
    EXPECT_TRUE(eventually(written)) << i;
  }
  EXPECT_EQ(counters()["recorder.lost_frames"], 0U);
}

TEST_F(RecorderTest, WhatItCouldNotDoOnAnyDay) {
  slam::Calibration calibration;
  calibration.width = 1024;
  calibration.height = 1024;
  Configuration::Record record;
  EXPECT_TRUE(checkRecorder(record, calibration));
  record.buffer_mib = 2;
  EXPECT_TRUE(checkRecorder(record, calibration)) << "nobody records";
  record.directory = directory_ / "later";
  EXPECT_EQ(checkRecorder(record, calibration).error().message,
            "record.buffer_mib: must be at least 3 for pictures of 1024x1024");
  record.images = false;
  EXPECT_TRUE(checkRecorder(record, calibration));
  record.images = true;
  record.buffer_mib = 3;
  EXPECT_TRUE(checkRecorder(record, calibration));
  record.directory = directory_ / "file";
  std::ofstream(record.directory) << "text";
  EXPECT_EQ(checkRecorder(record, calibration).error().message,
            record.directory.string() + ": is a file, where recordings should go");
}

}  // namespace
}  // namespace waymark::daemon
