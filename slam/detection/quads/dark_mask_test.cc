#include "slam/detection/quads/dark_mask.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "slam/testing/picture.h"

namespace waymark::slam {
namespace {

using testing::Picture;

Picture noise(int width, int height, unsigned seed) {
  Picture picture(width, height, 0);
  std::mt19937 rng(seed);
  std::uniform_int_distribution<int> grey(0, 255);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) picture.at(x, y) = static_cast<std::uint8_t>(grey(rng));
  }
  return picture;
}

// Beyond the border, the border's own pixel.
int nearest(const Picture& picture, int x, int y) {
  return picture.at(std::clamp(x, 0, picture.width() - 1), std::clamp(y, 0, picture.height() - 1));
}

// By the definition, pixel by pixel.
bool isDark(const Picture& picture, int x, int y, const DarkMaskOptions& options) {
  int sum = 0;
  const int upper = y - y % 2;  // of the two rows that share their windows
  for (int dy = -7; dy < 9; ++dy) {
    for (int dx = -8; dx < 8; ++dx) sum += nearest(picture, x + dx, upper + dy);
  }
  const auto factor = static_cast<unsigned>(std::lround(65536.0 * (1.0 - options.share) / 256.0));
  const auto level = static_cast<int>(static_cast<unsigned>(sum) * factor >> 16U);
  return nearest(picture, x, y) + std::lround(options.offset) < level;
}

TEST(DarkMask, IsWhatItsDefinitionSays) {
  for (const int width : {64, 65, 97, 130}) {
    const Picture picture = noise(width, 40, static_cast<unsigned>(width));
    const DarkMaskOptions options{.share = 0.1, .offset = 5.0};
    DarkMaskMaker maker(std::array{DarkMaskOptions{.share = 0.3, .offset = 9.0}, options});
    const DarkMask& mask = maker.make(picture.view())[1];
    const auto dark = [&](int x, int y) {
      return x >= 0 && y >= 0 && x < width && y < 40 && isDark(picture, x, y, options);
    };
    int dark_pixels = 0;
    for (int y = 0; y < 40; ++y) {
      for (int x = 0; x < width; ++x) {
        const bool in_company =
            (dark(x - 1, y) || dark(x + 1, y)) && (dark(x, y - 1) || dark(x, y + 1));
        ASSERT_EQ(mask.dark(x, y), dark(x, y) && in_company) << x << ", " << y << " of " << width;
        dark_pixels += mask.dark(x, y) ? 1 : 0;
      }
      const std::uint64_t last = mask.row(y)[mask.wordsPerRow() - 1];
      if (width % 64 != 0) {
        EXPECT_EQ(last >> static_cast<unsigned>(width % 64), 0U) << "beyond the width";
      }
    }
    EXPECT_GT(dark_pixels, width * 40 / 10);
  }
}

TEST(DarkMask, CountsTheRunsInItsRows) {
  for (const int width : {64, 65, 130}) {
    DarkMaskMaker maker(std::array{DarkMaskOptions{}});
    const DarkMask& mask = maker.make(noise(width, 40, 3).view())[0];
    int runs = 0;
    for (int y = 0; y < 40; ++y) {
      for (int x = 0; x < width; ++x) {
        runs += mask.dark(x, y) && (x == 0 || !mask.dark(x - 1, y)) ? 1 : 0;
      }
    }
    EXPECT_GT(runs, 100);
    EXPECT_EQ(mask.countRuns(), runs);
  }
}

TEST(DarkMask, SquaresAreDarkInAnyLight) {
  for (const int light : {30, 90, 250}) {
    Picture picture(80, 60, static_cast<std::uint8_t>(light));
    picture.paint(static_cast<std::uint8_t>(light / 4),
                  [](int x, int y) { return x >= 30 && x < 42 && y >= 20 && y < 32; });
    DarkMaskMaker maker(std::array{DarkMaskOptions{}});
    const DarkMask& mask = maker.make(picture.view())[0];
    int dark_pixels = 0;
    for (int y = 0; y < 60; ++y) {
      for (int x = 0; x < 80; ++x) dark_pixels += mask.dark(x, y) ? 1 : 0;
    }
    EXPECT_EQ(dark_pixels, 12 * 12) << "light " << light;
    EXPECT_TRUE(mask.dark(30, 20) && mask.dark(41, 31)) << "light " << light;
  }
}

TEST(DarkMask, OfAnotherSizeNextTime) {
  DarkMaskMaker maker(std::array{DarkMaskOptions{}});
  (void)maker.make(noise(100, 50, 1).view());
  const Picture small = noise(33, 20, 2);
  const DarkMask& mask = maker.make(small.view())[0];
  EXPECT_EQ(mask.width(), 33);
  EXPECT_EQ(mask.height(), 20);
  DarkMaskMaker fresh_maker(std::array{DarkMaskOptions{}});
  const DarkMask& fresh = fresh_maker.make(small.view())[0];
  for (int y = 0; y < 20; ++y) {
    for (int x = 0; x < 33; ++x) EXPECT_EQ(mask.dark(x, y), fresh.dark(x, y));
  }
}

}  // namespace
}  // namespace waymark::slam
