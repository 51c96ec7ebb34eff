#include "tools/diagnosis/image_quality.h"

#include <vector>

#include <gtest/gtest.h>

#include "tools/diagnosis/testing_sheet.h"

namespace waymark::diagnosis {
namespace {

using testing::blurred;
using testing::sheetOf;

GreyImage scaled(GreyImage image, double gain) {
  for (auto& pixel : image.pixels) {
    pixel = static_cast<std::uint8_t>(std::min(255.0, gain * pixel));
  }
  return image;
}

std::vector<std::string> adviceOn(const GreyImage& image) {
  return qualityAdvice(measureQuality(image.view()));
}

const GreyImage& goodImage() {
  static const GreyImage image = sheetOf("ARUCO_MIP_36h12", {0, 1, 2, 3, 4, 5, 6, 7});
  return image;
}

TEST(ImageQuality, AGoodImageNeedsNoAdvice) {
  const ImageQuality quality = measureQuality(goodImage().view());
  EXPECT_NEAR(quality.edge_width_px, 2.0, 0.1);
  EXPECT_EQ(quality.dark, 30);
  EXPECT_EQ(quality.bright, 225);
  EXPECT_EQ(quality.saturated, 0.0);
  EXPECT_TRUE(adviceOn(goodImage()).empty());
}

TEST(ImageQuality, EdgesAreAsWideAsTheBlur) {
  const GreyImage large = sheetOf("ARUCO_MIP_36h12", {1}, 640, 480, 30);
  for (const int radius : {1, 3, 4}) {
    const double width_px = measureQuality(blurred(large, radius).view()).edge_width_px;
    EXPECT_NEAR(width_px, 2.0 * radius + 1.0, 1.0) << radius;
  }
}

TEST(ImageQuality, SaysWhatIsWrong) {
  const auto said = [](const GreyImage& image, const char* what) {
    const std::vector<std::string> advice = adviceOn(image);
    ASSERT_EQ(advice.size(), 1U) << what;
    EXPECT_NE(advice.front().find(what), std::string::npos) << advice.front();
  };
  said(blurred(goodImage(), 4), "nothing in the images is sharp");
  said(scaled(goodImage(), 0.2), "the images are dark");
  said(scaled(goodImage(), 1.3), "overexposed");
  GreyImage grey = goodImage();
  for (auto& pixel : grey.pixels) pixel = 128;
  said(grey, "show nothing");
}

TEST(ImageQuality, OfSeveralImagesTheMedianCounts) {
  const std::vector<GreyImage> images = {goodImage(), goodImage(), scaled(goodImage(), 0.1)};
  EXPECT_TRUE(qualityAdvice(medianQuality(images)).empty());
  EXPECT_EQ(medianQuality({}).bright, 0);
}

TEST(ImageQuality, TinyImagesAndNoneAtAllAreNoFault) {
  EXPECT_EQ(measureQuality({}).edge_width_px, 0.0);
  const GreyImage dot{1, 1, {77}};
  EXPECT_EQ(measureQuality(dot.view()).median, 77);
}

}  // namespace
}  // namespace waymark::diagnosis
