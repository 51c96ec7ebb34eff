#include "capture/image_directory_source.h"

#include <fstream>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sys/stat.h>

#include "tests/temporary_directory.h"

namespace waymark::capture {
namespace {

using std::chrono_literals::operator""ms;
using waymark::testing::TemporaryDirectory;

// An image whose grey value tells it apart.
void writeImage(const std::filesystem::path& path, int grey, int width = 32, int height = 24) {
  ASSERT_TRUE(cv::imwrite(path.string(), cv::Mat(height, width, CV_8UC1, cv::Scalar(grey))));
}

struct Seen {
  int grey;
  std::int64_t time_ns;
  bool operator==(const Seen&) const = default;
};

// Every frame; the error that ended the stream goes to *error.
std::vector<Seen> readAll(FrameSource& source, std::string* error) {
  std::vector<Seen> seen;
  for (;;) {
    const ReadResult result = source.read(0ms);
    if (const Error* failure = std::get_if<Error>(&result)) *error = failure->message;
    const FramePtr* frame = std::get_if<FramePtr>(&result);
    if (frame == nullptr) return seen;
    EXPECT_EQ((*frame)->stamp().sequence, seen.size());
    seen.push_back({(*frame)->image().at(31, 23), (*frame)->stamp().monotonic_ns});
  }
}

TEST(ImageDirectorySource, OrderIsThatOfTheNames) {
  const TemporaryDirectory directory;
  writeImage(directory / "b.PNG", 2);
  writeImage(directory / "c.pgm", 3);
  writeImage(directory / "a.bmp", 1);
  std::ofstream(directory / "notes.md") << "not an image";
  const auto source = openImageDirectory(directory.path(), 10.0);
  ASSERT_TRUE(source.ok()) << source.error().message;
  std::string error;
  EXPECT_EQ(readAll(**source, &error),
            (std::vector<Seen>{{1, 0}, {2, 100'000'000}, {3, 200'000'000}}));
  EXPECT_EQ(error, "");
}

TEST(ImageDirectorySource, TimesComeFromFramesTxt) {
  const TemporaryDirectory directory;
  writeImage(directory / "late.png", 2);
  writeImage(directory / "early.png", 1);
  std::ofstream(directory / "frames.txt")
      << "# file seconds\nearly.png 1560889276.319020123\n\nlate.png 1560889276.4\n";
  const auto source = openImageDirectory(directory.path(), std::nullopt);
  ASSERT_TRUE(source.ok()) << source.error().message;
  std::string error;
  EXPECT_EQ(readAll(**source, &error),
            (std::vector<Seen>{{1, 1560889276319020123}, {2, 1560889276400000000}}));
}

TEST(ImageDirectorySource, AJpegThatIsCutOff) {
  const TemporaryDirectory directory;
  cv::Mat noise(24, 32, CV_8UC1);
  cv::randu(noise, 0, 256);
  std::vector<unsigned char> jpeg;
  for (const int progressive : {0, 1}) {
    ASSERT_TRUE(cv::imencode(".jpg", noise, jpeg, {cv::IMWRITE_JPEG_PROGRESSIVE, progressive}));
    const std::string whole(jpeg.begin(), jpeg.end());
    std::ofstream(directory / "1.jpg") << whole;
    std::ofstream(directory / "2.jpg") << whole << "a camera's trailer";
    std::ofstream(directory / "3.jpg") << whole.substr(0, whole.size() - 30);
    const auto source = openImageDirectory(directory.path(), 10.0);
    ASSERT_TRUE(source.ok()) << source.error().message;
    std::string error;
    EXPECT_EQ(readAll(**source, &error).size(), 2U);
    EXPECT_EQ(error, (directory / "3.jpg").string() + ": is cut off");
  }
}

TEST(ImageDirectorySource, OfABadPngTheDecoderWritesNothing) {
  const TemporaryDirectory directory;
  writeImage(directory / "1.png", 1);
  std::ifstream stream(directory / "1.png", std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(stream), {}};
  std::string damaged = whole;
  damaged[whole.size() / 2] = static_cast<char>(damaged[whole.size() / 2] ^ 1);
  for (const auto& [bytes, fault] :
       {std::pair{whole.substr(0, whole.size() - 1), "is cut off"},
        std::pair{whole.substr(0, whole.size() / 2), "is cut off"},
        std::pair{whole.substr(0, 8), "is cut off"}, std::pair{damaged, "is damaged"}}) {
    std::ofstream(directory / "2.png", std::ios::binary) << bytes;
    const auto source = openImageDirectory(directory.path(), 10.0);
    ASSERT_TRUE(source.ok()) << source.error().message;
    std::string error;
    ::testing::internal::CaptureStderr();
    EXPECT_EQ(readAll(**source, &error).size(), 1U);
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
    EXPECT_EQ(error, (directory / "2.png").string() + ": " + fault);
  }
}

TEST(ImageDirectorySource, AFifoIsNotWaitedFor) {
  const TemporaryDirectory directory;
  writeImage(directory / "1.png", 1);
  ASSERT_EQ(::mkfifo((directory / "2.png").c_str(), 0600), 0);
  const auto source = openImageDirectory(directory.path(), 10.0);
  ASSERT_TRUE(source.ok()) << source.error().message;
  std::string error;
  EXPECT_EQ(readAll(**source, &error).size(), 1U);
  EXPECT_EQ(error, (directory / "2.png").string() + ": is not a readable image");
}

TEST(ImageDirectorySource, FaultsOfFramesTxtNameTheLine) {
  const TemporaryDirectory directory;
  writeImage(directory / "a.png", 1);
  for (const auto& [text, reason] : {std::pair{"a.png 1\na.png 1\n", ":2: time 1 is not later"},
                                     std::pair{"a.png\n", ":1: must be: FILE SECONDS"},
                                     std::pair{"a.png soon\n", ":1: 'soon' is not a time"},
                                     std::pair{"\nb.png 1\n", "b.png: is not a readable image"},
                                     std::pair{"# nothing\n", ": has no images"}}) {
    std::ofstream(directory / "frames.txt") << text;
    const auto source = openImageDirectory(directory.path(), std::nullopt);
    ASSERT_FALSE(source.ok()) << text;
    EXPECT_NE(source.error().message.find(reason), std::string::npos) << source.error().message;
  }
}

TEST(ImageDirectorySource, AnotherSizeIsAnErrorThatNamesBoth) {
  const TemporaryDirectory directory;
  writeImage(directory / "a.png", 1);
  writeImage(directory / "b.png", 2, 64, 48);
  const auto source = openImageDirectory(directory.path(), 10.0);
  ASSERT_TRUE(source.ok());
  std::string error;
  EXPECT_EQ(readAll(**source, &error).size(), 1U);
  EXPECT_EQ(error, (directory / "b.png").string() + ": is 64x48, the images before are 32x24");
}

TEST(ImageDirectorySource, BrokenImageIsAnErrorThatNamesIt) {
  const TemporaryDirectory directory;
  writeImage(directory / "a.png", 1);
  std::ofstream(directory / "b.png") << "no image";
  const auto source = openImageDirectory(directory.path(), 10.0);
  ASSERT_TRUE(source.ok());
  std::string error;
  EXPECT_EQ(readAll(**source, &error).size(), 1U);
  EXPECT_EQ(error, (directory / "b.png").string() + ": is not a readable image");
}

TEST(ImageDirectorySource, AssumedRateIsSaid) {
  const TemporaryDirectory directory;
  writeImage(directory / "a.png", 1);
  const auto source = openImageDirectory(directory.path(), std::nullopt);
  ASSERT_TRUE(source.ok());
  EXPECT_NE((*source)->info().description.find("30 Hz (assumed)"), std::string::npos);
  EXPECT_TRUE((*source)->info().photographs);
}

TEST(ImageDirectorySource, EmptyDirectoryIsAnError) {
  const TemporaryDirectory directory;
  const auto source = openImageDirectory(directory.path(), 10.0);
  ASSERT_FALSE(source.ok());
  EXPECT_EQ(source.error().message, directory.path().string() + ": has no images");
}

}  // namespace
}  // namespace waymark::capture
