#include "capture/jpeg_encoder.h"

#include <cmath>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

#include "capture/jpeg_decoder.h"

namespace waymark::capture {
namespace {

constexpr int kWidth = 50;
constexpr int kHeight = 30;
constexpr int kStride = 64;

// Soft shapes, with something else beyond the end of each row.
std::vector<std::uint8_t> picture() {
  std::vector<std::uint8_t> pixels(std::size_t{kStride} * kHeight, 255);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      pixels[static_cast<std::size_t>(y * kStride + x)] =
          static_cast<std::uint8_t>(128.0 + 60.0 * std::sin(0.2 * x) * std::cos(0.15 * y));
    }
  }
  return pixels;
}

TEST(JpegEncoder, ComesBackAsItWas) {
  const std::vector<std::uint8_t> pixels = picture();
  JpegEncoder encoder;
  JpegDecoder decoder;
  for (int round = 0; round < 2; ++round) {
    const auto jpeg = encoder.encode({pixels.data(), kWidth, kHeight, kStride}, 95);
    ASSERT_FALSE(jpeg.empty());
    EXPECT_LT(jpeg.size(), std::size_t{kWidth} * kHeight);
    std::vector<std::uint8_t> grey(std::size_t{kWidth} * kHeight);
    ASSERT_FALSE(decoder.decode(jpeg, kWidth, kHeight, grey.data()));
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        EXPECT_NEAR(grey[static_cast<std::size_t>(y * kWidth + x)],
                    pixels[static_cast<std::size_t>(y * kStride + x)], 4);
      }
    }
  }
}

TEST(JpegEncoder, WhatIsNoPictureIsNotEncoded) {
  JpegEncoder encoder;
  EXPECT_TRUE(encoder.encode({}, 80).empty());
}

}  // namespace
}  // namespace waymark::capture
