#include "tools/diagnosis/grey_image.h"

#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::diagnosis {
namespace {

TEST(GreyImage, CopiesLeaveThePaddingOut) {
  const std::vector<std::uint8_t> padded = {1, 2, 99, 3, 4, 99};
  const ImageView view{padded.data(), 2, 2, 3};
  EXPECT_EQ(copyOf(view).pixels, (std::vector<std::uint8_t>{1, 2, 3, 4}));
  EXPECT_EQ(mirrored(view).pixels, (std::vector<std::uint8_t>{2, 1, 4, 3}));
  EXPECT_EQ(inverted(view).pixels, (std::vector<std::uint8_t>{254, 253, 252, 251}));
}

TEST(ImageSamples, AreSpreadEvenlyHoweverManyThereAre) {
  for (const int frames : {1, 7, 8, 15, 16, 17, 100, 1000}) {
    ImageSamples samples(8);
    for (int i = 0; i < frames; ++i) {
      const std::uint8_t pixels[2] = {static_cast<std::uint8_t>(i % 256),
                                      static_cast<std::uint8_t>(i / 256)};
      samples.add({pixels, 2, 1, 2});
    }
    std::vector<int> kept;
    for (const GreyImage& image : samples.images()) {
      kept.push_back(image.pixels[0] + 256 * image.pixels[1]);
    }
    ASSERT_FALSE(kept.empty());
    EXPECT_GE(kept.size(), static_cast<std::size_t>(std::min(frames, 8))) << frames;
    EXPECT_LT(kept.size(), 16U) << frames;
    EXPECT_EQ(kept.front(), 0);
    for (std::size_t i = 2; i < kept.size(); ++i) {
      EXPECT_EQ(kept[i] - kept[i - 1], kept[1] - kept[0]) << frames;
    }
    if (kept.size() > 1) {
      EXPECT_GE(kept.back() + kept[1] - kept[0], frames - 1) << "up to the end, of " << frames;
    }
  }
}

}  // namespace
}  // namespace waymark::diagnosis
