#include "capture/video_source.h"

#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

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

void writeVideo(const std::filesystem::path& path, const std::vector<cv::Mat>& frames,
                const char* codec = "FFV1") {
  cv::VideoWriter writer(path.string(), cv::CAP_FFMPEG,
                         cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]), kRate,
                         {kWidth, kHeight}, /*isColor=*/false);
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

TEST(VideoSource, ACutOffAviIsAnErrorAtItsEnd) {
  const TemporaryDirectory directory;
  writeVideo(directory / "v.avi", noiseFrames());
  const std::string bytes = readBytes(directory / "v.avi");
  const std::size_t header = bytes.find("movi");
  for (const std::size_t kept : {bytes.size() * 9 / 10, bytes.size() / 2, header + 1000}) {
    writeBytes(directory / "cut", bytes.substr(0, kept));
    const auto source = openVideo(directory / "cut", std::nullopt);
    ASSERT_TRUE(source.ok()) << source.error().message;
    int frames = 0;
    const std::string error = readAll(**source, &frames);
    EXPECT_LT(frames, kFrames);
    EXPECT_NE(error.find("cut: frame " + std::to_string(frames) + ": "), std::string::npos)
        << error;
    EXPECT_NE(error.find(frames == 0 ? "cannot be decoded" : "promises 20 frames"),
              std::string::npos)
        << error;
  }
  // What stands behind the frames is missed by nobody.
  const std::size_t index = bytes.rfind("idx1");
  ASSERT_NE(index, std::string::npos);
  writeBytes(directory / "cut", bytes.substr(0, index));
  const auto source = openVideo(directory / "cut", std::nullopt);
  ASSERT_TRUE(source.ok()) << source.error().message;
  int frames = 0;
  EXPECT_EQ(readAll(**source, &frames), "");
  EXPECT_EQ(frames, kFrames);
}

// Its header stands at the end.
TEST(VideoSource, ACutOffMp4IsAnErrorAtOnce) {
  const TemporaryDirectory directory;
  writeVideo(directory / "v.mp4", noiseFrames(), "mp4v");
  const std::string bytes = readBytes(directory / "v.mp4");
  const auto whole = openVideo(directory / "v.mp4", std::nullopt);
  ASSERT_TRUE(whole.ok()) << whole.error().message;
  int frames = 0;
  EXPECT_EQ(readAll(**whole, &frames), "");
  EXPECT_EQ(frames, kFrames);
  for (const std::size_t kept : {bytes.size() * 9 / 10, bytes.size() / 2, std::size_t{5000}}) {
    writeBytes(directory / "cut", bytes.substr(0, kept));
    const auto source = openVideo(directory / "cut", std::nullopt);
    ASSERT_FALSE(source.ok()) << kept;
    EXPECT_EQ(source.error().message, (directory / "cut").string() + ": is not a video");
  }
}

// A recorder that was killed leaves a header without a length and a number of frames.
TEST(VideoSource, AnAviThatWasNeverFinishedReadsToItsEnd) {
  const TemporaryDirectory directory;
  writeVideo(directory / "v.avi", noiseFrames());
  std::string bytes = readBytes(directory / "v.avi");
  constexpr std::size_t kLengthField = 8 + 32;
  constexpr std::size_t kFramesField = 8 + 16;
  std::memset(bytes.data() + 4, 0, 4);
  std::memset(bytes.data() + bytes.find("avih") + kFramesField, 0, 4);
  std::memset(bytes.data() + bytes.find("strh") + kLengthField, 0, 4);
  writeBytes(directory / "v.avi", bytes.substr(0, bytes.size() / 2));
  const auto source = openVideo(directory / "v.avi", std::nullopt);
  ASSERT_TRUE(source.ok()) << source.error().message;
  int frames = 0;
  EXPECT_EQ(readAll(**source, &frames), "");
  EXPECT_GT(frames, kFrames / 4);
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

}  // namespace
}  // namespace waymark::capture
