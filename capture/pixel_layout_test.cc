#include "capture/pixel_layout.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::capture {
namespace {

// Not a multiple of any vector's length, so that the last pixels go another way.
constexpr int kWidth = 53;
constexpr int kHeight = 7;
constexpr std::ptrdiff_t kGap = 11;  // bytes between the rows that belong to nobody

std::uint8_t greyAt(int x, int y) { return static_cast<std::uint8_t>(7 * x + 31 * y + x * y); }

// Rows as a camera lays them: `put` writes the pixel (x, y) into its row.
template <typename Put>
std::vector<std::uint8_t> camera(PixelLayout layout, std::ptrdiff_t* stride, Put put) {
  *stride = static_cast<std::ptrdiff_t>(bytesPerRow(layout, kWidth)) + kGap;
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(*stride * kHeight), 0xa5);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) put(bytes.data() + y * *stride, x, y);
  }
  return bytes;
}

template <typename Put>
void expectGrey(PixelLayout layout, Put put) {
  std::ptrdiff_t stride = 0;
  const std::vector<std::uint8_t> bytes = camera(layout, &stride, put);
  std::vector<std::uint8_t> grey(static_cast<std::size_t>(kWidth * kHeight) + 1, 0x77);
  extractGrey(layout, bytes.data(), stride, kWidth, kHeight, grey.data());
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      ASSERT_EQ(grey[static_cast<std::size_t>(y * kWidth + x)], greyAt(x, y)) << x << " " << y;
    }
  }
  EXPECT_EQ(grey.back(), 0x77) << "written past the end";
}

void putWord(std::uint8_t* row, int x, unsigned word) {
  row[2 * x] = static_cast<std::uint8_t>(word & 0xffU);
  row[2 * x + 1] = static_cast<std::uint8_t>(word >> 8U);
}

TEST(PixelLayout, AGreyPlaneIsCopied) {
  EXPECT_TRUE(isGreyPlane(PixelLayout::kGrey8));
  expectGrey(PixelLayout::kGrey8, [](std::uint8_t* row, int x, int y) { row[x] = greyAt(x, y); });
}

TEST(PixelLayout, GreyBesideColours) {
  expectGrey(PixelLayout::kGreyEven,
             [](std::uint8_t* row, int x, int y) { row[2 * x] = greyAt(x, y); });
  expectGrey(PixelLayout::kGreyOdd,
             [](std::uint8_t* row, int x, int y) { row[2 * x + 1] = greyAt(x, y); });
}

TEST(PixelLayout, TheHighestBitsOfWords) {
  expectGrey(PixelLayout::kGrey10,
             [](std::uint8_t* row, int x, int y) { putWord(row, x, (greyAt(x, y) << 2U) | 3U); });
  expectGrey(PixelLayout::kGrey12,
             [](std::uint8_t* row, int x, int y) { putWord(row, x, (greyAt(x, y) << 4U) | 9U); });
  expectGrey(PixelLayout::kGrey16,
             [](std::uint8_t* row, int x, int y) { putWord(row, x, (greyAt(x, y) << 8U) | 200U); });
}

TEST(PixelLayout, WordsBeyondTheirBitsAreWhite) {
  const std::array<std::uint8_t, 4> bytes{0x00, 0xff, 0xff, 0x03};
  std::array<std::uint8_t, 2> grey{};
  extractGrey(PixelLayout::kGrey10, bytes.data(), 4, 2, 1, grey.data());
  EXPECT_EQ(grey[0], 255);
  EXPECT_EQ(grey[1], 255);
}

// Behind a filter, an even red surface is bright where the filter is red and dark elsewhere. What
// comes out is as grey as red is in grey pictures, 30 % of it, green 59 %, blue 11 %, everywhere.
TEST(PixelLayout, ColoursBehindABayerFilter) {
  struct Filter {
    PixelLayout layout;
    std::array<char, 4> colours;  // of the first two rows
  };
  const std::array filters = {Filter{PixelLayout::kBayerBGGR8, {'B', 'G', 'G', 'R'}},
                              Filter{PixelLayout::kBayerGBRG8, {'G', 'B', 'R', 'G'}},
                              Filter{PixelLayout::kBayerGRBG8, {'G', 'R', 'B', 'G'}},
                              Filter{PixelLayout::kBayerRGGB8, {'R', 'G', 'G', 'B'}}};
  const std::array surfaces = {std::pair{'R', 0.299}, std::pair{'G', 0.587}, std::pair{'B', 0.114}};
  for (const Filter& filter : filters) {
    for (const auto& [colour, share] : surfaces) {
      std::ptrdiff_t stride = 0;
      const auto bytes = camera(filter.layout, &stride, [&](std::uint8_t* row, int x, int y) {
        const auto place = static_cast<std::size_t>(2 * (y % 2) + x % 2);
        row[x] = filter.colours[place] == colour ? 200 : 0;
      });
      std::vector<std::uint8_t> grey(static_cast<std::size_t>(kWidth * kHeight));
      extractGrey(filter.layout, bytes.data(), stride, kWidth, kHeight, grey.data());
      for (const std::uint8_t value : grey) ASSERT_NEAR(value, 200.0 * share, 1.5) << colour;
    }
  }
}

TEST(PixelLayout, ColoursBesideEachOther) {
  for (const PixelLayout layout : {PixelLayout::kRgb24, PixelLayout::kBgr24}) {
    std::ptrdiff_t stride = 0;
    const auto bytes = camera(layout, &stride, [&](std::uint8_t* row, int x, int y) {
      const int red = layout == PixelLayout::kRgb24 ? 0 : 2;
      row[3 * x] = row[3 * x + 1] = row[3 * x + 2] = 0;
      row[3 * x + red] = greyAt(x, y);
    });
    std::vector<std::uint8_t> grey(static_cast<std::size_t>(kWidth * kHeight));
    extractGrey(layout, bytes.data(), stride, kWidth, kHeight, grey.data());
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        ASSERT_NEAR(grey[static_cast<std::size_t>(y * kWidth + x)], 0.299 * greyAt(x, y), 1.0);
      }
    }
  }
}

}  // namespace
}  // namespace waymark::capture
