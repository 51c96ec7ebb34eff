#include "tools/natural/picture_range.h"

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::tools {
namespace {

constexpr int kWidth = 400;
constexpr int kHeight = 300;

// A sheet with rectangles all over, 0.3 m wide.
slam::NaturalMarker sheet(unsigned seed) {
  std::mt19937 rng(seed);
  const auto upTo = [&](int most) { return static_cast<int>(rng() % static_cast<unsigned>(most)); };
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(kWidth) * kHeight, 120);
  for (int i = 0; i < 150; ++i) {
    const int width = 8 + upTo(40);
    const int height = 8 + upTo(40);
    const int left = upTo(kWidth - width);
    const int top = upTo(kHeight - height);
    const auto grey = static_cast<std::uint8_t>(upTo(256));
    for (int y = top; y < top + height; ++y) {
      for (int x = left; x < left + width; ++x) {
        pixels[static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x)] = grey;
      }
    }
  }
  return *slam::NaturalMarker::create({pixels.data(), kWidth, kHeight, kWidth}, 0.3, 0.0);
}

TEST(PictureRange, IsFromWhereAllOfThePictureIsInTheImageToWhereItIsTooSmall) {
  std::vector<slam::NaturalMarker> markers;
  markers.push_back(sheet(1));
  markers.push_back(sheet(2));
  slam::PictureFinder finder(markers);
  const slam::Calibration camera = ordinaryCamera();
  const auto ranges = pictureRange(markers[1], 1, camera, &finder, {.tilts_deg = {0.0}});
  ASSERT_EQ(ranges.size(), 1U);
  ASSERT_TRUE(ranges[0].nearest_m && ranges[0].farthest_m);
  EXPECT_NEAR(*ranges[0].nearest_m, 0.3 * 512.0 / (0.9 * 640.0), 1e-9);
  EXPECT_GT(*ranges[0].farthest_m, 1.0) << "150 pixels wide";
  EXPECT_LT(*ranges[0].farthest_m, 15.0) << "10 pixels wide";
  // It is not the other one.
  const auto other =
      pictureRange(markers[1], 0, camera, &finder, {.tilts_deg = {0.0}, .nearest_times = 1.5});
  ASSERT_EQ(other.size(), 1U);
  EXPECT_FALSE(other[0].nearest_m);
}

}  // namespace
}  // namespace waymark::tools
