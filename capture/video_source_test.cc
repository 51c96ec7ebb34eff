#include "capture/video_source.h"

#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include "capture/container_length.h"
#include "tests/temporary_directory.h"

namespace waymark::capture {
namespace {

using std::chrono_literals::operator""ms;
using waymark::testing::TemporaryDirectory;

constexpr int kWidth = 160;
constexpr int kHeight = 120;
constexpr int kFrames = 20;
constexpr double kRate = 60.0;

// Noise, so that a single changed grey value shows.
std::vector<cv::Mat> noiseFrames() {
  cv::RNG rng(7);
  std::vector<cv::Mat> frames;
  for (int i = 0; i < kFrames; ++i) {
    cv::Mat frame(kHeight, kWidth, CV_8UC1);
    rng.fill(frame, cv::RNG::UNIFORM, 0, 256);
    frames.push_back(frame);
  }
  return frames;
}

void writeVideo(const std::filesystem::path& path, const std::vector<cv::Mat>& frames) {
  cv::VideoWriter writer(path.string(), cv::CAP_FFMPEG, cv::VideoWriter::fourcc('F', 'F', 'V', '1'),
                         kRate, {kWidth, kHeight},
                         /*isColor=*/false);
  ASSERT_TRUE(writer.isOpened());
  for (const cv::Mat& frame : frames) writer.write(frame);
}

std::string readBytes(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

void writeBytes(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// Reads to the end; the error's message, or empty for an orderly end.
std::string readAll(FrameSource& source, int* frames) {
  for (*frames = 0;; ++*frames) {
    const ReadResult result = source.read(0ms);
    if (const Error* error = std::get_if<Error>(&result)) return error->message;
    if (!std::holds_alternative<FramePtr>(result)) return {};
  }
}

class VideoSourceTest : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Containers, VideoSourceTest, ::testing::Values("v.avi", "v.mkv"));

TEST_P(VideoSourceTest, GreyPixelsAndTimesAreExact) {
  const TemporaryDirectory directory;
  const std::vector<cv::Mat> frames = noiseFrames();
  writeVideo(directory / GetParam(), frames);
  const auto source = openVideo(directory / GetParam(), std::nullopt);
  ASSERT_TRUE(source.ok()) << source.error().message;
  EXPECT_EQ((*source)->info().width, kWidth);
  EXPECT_EQ((*source)->info().frame_count, kFrames);
  EXPECT_FALSE((*source)->info().live);
  for (int i = 0; i < kFrames; ++i) {
    ReadResult result = (*source)->read(0ms);
    ASSERT_TRUE(std::holds_alternative<FramePtr>(result));
    const FramePtr frame = std::get<FramePtr>(std::move(result));
    EXPECT_EQ(frame->stamp().sequence, static_cast<std::uint64_t>(i));
    EXPECT_EQ(frame->stamp().monotonic_ns, std::llround(1e9 * i / kRate));
    const cv::Mat pixels(kHeight, kWidth, CV_8UC1, frame->pixels());
    EXPECT_EQ(cv::norm(pixels, frames[static_cast<std::size_t>(i)], cv::NORM_INF), 0.0) << i;
  }
  EXPECT_TRUE(std::holds_alternative<EndOfStream>((*source)->read(0ms)));
  EXPECT_EQ((*source)->counters().frames, static_cast<std::uint64_t>(kFrames));
}

TEST_P(VideoSourceTest, GivenRateOverridesTheContainers) {
  const TemporaryDirectory directory;
  writeVideo(directory / GetParam(), noiseFrames());
  const auto source = openVideo(directory / GetParam(), 10.0);
  ASSERT_TRUE(source.ok());
  for (const std::int64_t time_ns : {0, 100'000'000, 200'000'000}) {
    const ReadResult result = (*source)->read(0ms);
    EXPECT_EQ(std::get<FramePtr>(result)->stamp().monotonic_ns, time_ns);
  }
}

TEST_P(VideoSourceTest, AnyCutIsAnError) {
  const TemporaryDirectory directory;
  writeVideo(directory / GetParam(), noiseFrames());
  const std::string bytes = readBytes(directory / GetParam());
  for (const std::size_t kept : {bytes.size() - 1, bytes.size() / 2, std::size_t{5000}}) {
    writeBytes(directory / "cut", bytes.substr(0, kept));
    const auto source = openVideo(directory / "cut", std::nullopt);
    ASSERT_FALSE(source.ok()) << kept;
    EXPECT_NE(source.error().message.find("cut: is truncated"), std::string::npos)
        << source.error().message;
  }
}

TEST_P(VideoSourceTest, FramesAreHeldBackWhileEveryBufferIsOut) {
  const TemporaryDirectory directory;
  writeVideo(directory / GetParam(), noiseFrames());
  const auto source = openVideo(directory / GetParam(), std::nullopt);
  ASSERT_TRUE(source.ok());
  std::vector<ReadResult> held;
  do {
    held.push_back((*source)->read(0ms));
  } while (std::holds_alternative<FramePtr>(held.back()));
  EXPECT_TRUE(std::holds_alternative<TimedOut>(held.back()));
  const std::size_t taken = held.size() - 1;
  held.clear();
  const ReadResult next = (*source)->read(0ms);
  ASSERT_TRUE(std::holds_alternative<FramePtr>(next));
  EXPECT_EQ(std::get<FramePtr>(next)->stamp().sequence, taken);
}

// A header that promises more frames than there are, in a file of the right length.
TEST(VideoSource, MissingFramesAreAnErrorAtTheEnd) {
  const TemporaryDirectory directory;
  writeVideo(directory / "v.avi", noiseFrames());
  std::string bytes = readBytes(directory / "v.avi");
  const std::size_t header = bytes.find("strh");
  ASSERT_NE(header, std::string::npos);
  constexpr std::size_t kLengthField = 8 + 32;
  bytes[header + kLengthField] = kFrames + 10;
  writeBytes(directory / "v.avi", bytes);
  const auto source = openVideo(directory / "v.avi", std::nullopt);
  ASSERT_TRUE(source.ok()) << source.error().message;
  int frames = 0;
  const std::string error = readAll(**source, &frames);
  EXPECT_EQ(frames, kFrames);
  EXPECT_NE(error.find("v.avi: frame 20: "), std::string::npos) << error;
  EXPECT_NE(error.find("promises 30 frames"), std::string::npos) << error;
}

TEST(VideoSource, WhatIsNoVideoIsAnError) {
  const TemporaryDirectory directory;
  writeBytes(directory / "text.avi", "not a video\n");
  writeBytes(directory / "empty.avi", "");
  for (const char* name : {"text.avi", "empty.avi"}) {
    const auto source = openVideo(directory / name, std::nullopt);
    ASSERT_FALSE(source.ok());
    EXPECT_EQ(source.error().message, (directory / name).string() + ": is not a video");
  }
  const auto missing = openVideo(directory / "missing.avi", std::nullopt);
  ASSERT_FALSE(missing.ok());
  EXPECT_NE(missing.error().message.find("missing.avi: cannot be read: No such file"),
            std::string::npos);
}

TEST(VideoSource, RealRecordingsReadToTheirEnd) {
  const char* data = std::getenv("WAYMARK_SHARED_DATA");
  if (data == nullptr || !std::filesystem::exists(data)) GTEST_SKIP() << "no real recordings here";
  for (const auto& [name, count] : {std::pair{"aruco_chess18", 149}, {"aruco_single6", 145}}) {
    const auto source = openVideo(std::filesystem::path(data) / name / "frames.avi", std::nullopt);
    ASSERT_TRUE(source.ok()) << source.error().message;
    int frames = 0;
    EXPECT_EQ(readAll(**source, &frames), "");
    EXPECT_EQ(frames, count);
  }
}

TEST(ContainerLength, CountsBytesOfAnMp4) {
  const TemporaryDirectory directory;
  std::string bytes(
      "\0\0\0\x10"
      "ftypisom\0\0\0\0"
      "\0\0\0\x0c"
      "mdat1234",
      28);
  writeBytes(directory / "v.mp4", bytes);
  const auto whole = containerLength(directory / "v.mp4");
  ASSERT_TRUE(whole.has_value());
  EXPECT_FALSE(whole->truncated());
  EXPECT_EQ(whole->declared_bytes, 28U);
  bytes.pop_back();
  writeBytes(directory / "v.mp4", bytes);
  EXPECT_TRUE(containerLength(directory / "v.mp4")->truncated());
}

}  // namespace
}  // namespace waymark::capture
