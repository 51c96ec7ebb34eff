#include "capture/jpeg_decoder.h"

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace waymark::capture {
namespace {

constexpr int kWidth = 164;  // not a multiple of a block
constexpr int kHeight = 90;

cv::Mat colourful() {
  cv::Mat picture(kHeight, kWidth, CV_8UC3, cv::Scalar(40, 90, 200));
  cv::circle(picture, {80, 40}, 30, {220, 220, 30}, cv::FILLED);
  cv::rectangle(picture, {10, 10, 30, 50}, {10, 10, 10}, cv::FILLED);
  cv::GaussianBlur(picture, picture, {5, 5}, 0.0);
  return picture;
}

std::vector<std::uint8_t> encode(const cv::Mat& picture) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, 92});
  return bytes;
}

class JpegDecoderTest : public testing::Test {
 protected:
  std::optional<std::string> decode(const std::vector<std::uint8_t>& bytes) {
    return decoder_.decode(bytes, kWidth, kHeight, grey_.data());
  }
  [[nodiscard]] cv::Mat grey() { return {kHeight, kWidth, CV_8UC1, grey_.data()}; }

  JpegDecoder decoder_;
  std::vector<std::uint8_t> grey_ =
      std::vector<std::uint8_t>(static_cast<std::size_t>(kWidth) * kHeight, 0);
};

TEST_F(JpegDecoderTest, TakesTheGreyOfAColourPicture) {
  ASSERT_EQ(decode(encode(colourful())), std::nullopt);
  cv::Mat expected;
  cv::cvtColor(colourful(), expected, cv::COLOR_BGR2GRAY);
  EXPECT_LT(cv::norm(grey(), expected, cv::NORM_L1) / (kWidth * kHeight), 1.0);
}

TEST_F(JpegDecoderTest, PaddingIsNoFault) {
  std::vector<std::uint8_t> bytes = encode(colourful());
  bytes.resize(bytes.size() + 1000, 0);
  EXPECT_EQ(decode(bytes), std::nullopt);
}

TEST_F(JpegDecoderTest, BytesBeforeTheEndMarkAreNoFault) {
  std::vector<std::uint8_t> bytes = encode(colourful());
  bytes.insert(bytes.end() - 2, {0x12, 0x34, 0x56});
  EXPECT_EQ(decode(bytes), std::nullopt);
}

TEST_F(JpegDecoderTest, HalfAPictureIsRejected) {
  const std::vector<std::uint8_t> whole = encode(colourful());
  std::vector<std::uint8_t> half(whole.begin(), whole.begin() + whole.size() / 2);
  EXPECT_EQ(decode(half), "JPEG picture without an end mark");
  half.insert(half.end(), {0xff, 0xd9});  // as if it were whole
  const std::optional<std::string> reason = decode(half);
  ASSERT_TRUE(reason);
  EXPECT_TRUE(reason->starts_with("JPEG data: ")) << *reason;
}

TEST_F(JpegDecoderTest, WhatIsNoPictureIsRejected) {
  EXPECT_EQ(decode({}), "JPEG picture without a start mark");
  EXPECT_EQ(decode({0xff, 0xd8}), "JPEG picture without a start mark");
  EXPECT_EQ(decode({0xff, 0xd8, 0xff, 0xd9}).has_value(), true);
  EXPECT_EQ(decode(std::vector<std::uint8_t>(5000, 0)), "JPEG picture without a start mark");
}

TEST_F(JpegDecoderTest, AnotherSizeIsRejected) {
  cv::Mat larger;
  cv::resize(colourful(), larger, {2 * kWidth, kHeight});
  EXPECT_EQ(decode(encode(larger)), "JPEG picture of 328x90 in a stream of 164x90");
}

// Whatever a broken cable makes of a picture: an answer, and the next whole picture is decoded.
TEST_F(JpegDecoderTest, SurvivesDamage) {
  const std::vector<std::uint8_t> whole = encode(colourful());
  std::mt19937 random(5);
  int rejected = 0;
  for (int i = 0; i < 300; ++i) {
    std::vector<std::uint8_t> bytes = whole;
    for (int k = 0; k < 8; ++k)
      bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
    rejected += decode(bytes).has_value() ? 1 : 0;
  }
  EXPECT_GT(rejected, 100);
  EXPECT_EQ(decode(whole), std::nullopt);
}

}  // namespace
}  // namespace waymark::capture
