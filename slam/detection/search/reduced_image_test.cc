#include "slam/detection/search/reduced_image.h"

#include <gtest/gtest.h>

#include "slam/testing/picture.h"

namespace waymark::slam {
namespace {

TEST(ImageReducer, PixelsAreMeans) {
  testing::Picture picture(43, 21, 0);  // neither divides by four
  for (int y = 0; y < picture.height(); ++y) {
    for (int x = 0; x < picture.width(); ++x) {
      picture.at(x, y) = static_cast<std::uint8_t>(5 * x + 2 * y);
    }
  }
  ImageReducer reducer;
  for (const int factor : {2, 4}) {
    const ImageView reduced = reducer.reduce(picture.view(), factor);
    ASSERT_EQ(reduced.width, 43 / factor);
    ASSERT_EQ(reduced.height, 21 / factor);
    for (int y = 0; y < reduced.height; ++y) {
      for (int x = 0; x < reduced.width; ++x) {
        // The grey levels are a plane: its mean is that of the square's middle.
        const double mean =
            5.0 * (factor * x + 0.5 * (factor - 1)) + 2.0 * (factor * y + 0.5 * (factor - 1));
        EXPECT_NEAR(reduced.at(x, y), mean, 0.51) << factor << ": " << x << ' ' << y;
      }
    }
  }
}

}  // namespace
}  // namespace waymark::slam
