#include "slam/natural/filter/corner_finder.h"

#include <cstdint>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

struct Image {
  Image() : pixels(100 * 80, 100) {}
  void fill(int left, int top, int right, int bottom, std::uint8_t grey) {
    for (int y = top; y < bottom; ++y) {
      for (int x = left; x < right; ++x) pixels[static_cast<std::size_t>(100 * y + x)] = grey;
    }
  }
  [[nodiscard]] ImageView view() const { return {pixels.data(), 100, 80, 100}; }
  std::vector<std::uint8_t> pixels;
};

TEST(CornerFinder, FindsACorner) {
  Image image;
  image.fill(40, 30, 100, 80, 180);
  CornerFinder finder;
  const FoundCorner corner = finder.best(image.view(), 10, 10, 90, 70, 5);
  EXPECT_GT(corner.score, 10.0F);
  EXPECT_NEAR(corner.x, 40, 3);
  EXPECT_NEAR(corner.y, 30, 3);
  // The strongest of two.
  image.fill(70, 50, 76, 80, 0);
  const FoundCorner other = finder.best(image.view(), 10, 10, 90, 70, 5);
  EXPECT_GT(other.score, corner.score);
  EXPECT_NEAR(other.y, 50, 3);
}

TEST(CornerFinder, AnEdgeIsNone) {
  Image image;
  image.fill(40, 0, 100, 80, 180);
  CornerFinder finder;
  EXPECT_LT(finder.best(image.view(), 10, 10, 90, 70, 5).score, 0.01F);
}

TEST(CornerFinder, StaysWithinThePartAndTheMargin) {
  Image image;
  image.fill(40, 30, 100, 80, 180);
  CornerFinder finder;
  EXPECT_LT(finder.best(image.view(), 50, 40, 90, 70, 5).score, 0.01F);
  EXPECT_EQ(finder.best(image.view(), 0, 0, 3, 3, 5).score, 0.0F);
  EXPECT_EQ(finder.best(image.view(), 60, 40, 50, 50, 5).score, 0.0F);
}

}  // namespace
}  // namespace waymark::slam
