#include "capture/pixel_layout.h"

#include <algorithm>
#include <bit>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/vectorized.h"

namespace waymark::capture {
namespace {

static_assert(std::endian::native == std::endian::little, "words are read as they lie in memory");

// Every second byte, from the first on.
WAYMARK_VECTORIZED void takeEverySecond(const std::uint8_t* in, int count, std::uint8_t* out) {
  for (int x = 0; x < count; ++x) out[x] = in[2 * x];
}

// Of each word the bits from `shift` on.
WAYMARK_VECTORIZED void takeHighBits(const std::uint8_t* in, int count, int shift,
                                     std::uint8_t* out) {
  for (int x = 0; x < count; ++x) {
    const unsigned word =
        static_cast<unsigned>(in[2 * x]) | (static_cast<unsigned>(in[2 * x + 1]) << 8U);
    // A camera that sets bits above its own has a picture to match: white.
    out[x] = static_cast<std::uint8_t>(std::min(word >> static_cast<unsigned>(shift), 255U));
  }
}

// code: OpenCV's; type: of the pixels as they come.
void weightColours(int code, int type, const std::uint8_t* rows, std::ptrdiff_t stride, int width,
                   int height, std::uint8_t* grey) {
  // OpenCV wants to write to what it only reads.
  const cv::Mat in(height, width, type, const_cast<std::uint8_t*>(rows),
                   static_cast<std::size_t>(stride));
  cv::Mat out(height, width, CV_8UC1, grey);
  cv::cvtColor(in, out, code);
}

void extractRow(PixelLayout layout, const std::uint8_t* row, int width, std::uint8_t* grey) {
  switch (layout) {
    case PixelLayout::kGreyEven:
      return takeEverySecond(row, width, grey);
    case PixelLayout::kGreyOdd:
      return takeEverySecond(row + 1, width, grey);
    case PixelLayout::kGrey10:
      return takeHighBits(row, width, 2, grey);
    case PixelLayout::kGrey12:
      return takeHighBits(row, width, 4, grey);
    case PixelLayout::kGrey16:
      return takeEverySecond(row + 1, width, grey);
    default:
      std::copy_n(row, width, grey);
  }
}

}  // namespace

std::size_t bytesPerRow(PixelLayout layout, int width) {
  const auto pixels = static_cast<std::size_t>(width);
  switch (layout) {
    case PixelLayout::kGreyEven:
    case PixelLayout::kGreyOdd:
    case PixelLayout::kGrey10:
    case PixelLayout::kGrey12:
    case PixelLayout::kGrey16:
      return 2 * pixels;
    case PixelLayout::kRgb24:
    case PixelLayout::kBgr24:
      return 3 * pixels;
    case PixelLayout::kJpeg:
      return 0;
    default:
      return pixels;
  }
}

void extractGrey(PixelLayout layout, const std::uint8_t* rows, std::ptrdiff_t stride, int width,
                 int height, std::uint8_t* grey) {
  const auto weigh = [&](int code, int type) {
    weightColours(code, type, rows, stride, width, height, grey);
  };
  switch (layout) {
    case PixelLayout::kBayerBGGR8:
      return weigh(cv::COLOR_BayerBGGR2GRAY, CV_8UC1);
    case PixelLayout::kBayerGBRG8:
      return weigh(cv::COLOR_BayerGBRG2GRAY, CV_8UC1);
    case PixelLayout::kBayerGRBG8:
      return weigh(cv::COLOR_BayerGRBG2GRAY, CV_8UC1);
    case PixelLayout::kBayerRGGB8:
      return weigh(cv::COLOR_BayerRGGB2GRAY, CV_8UC1);
    case PixelLayout::kRgb24:
      return weigh(cv::COLOR_RGB2GRAY, CV_8UC3);
    case PixelLayout::kBgr24:
      return weigh(cv::COLOR_BGR2GRAY, CV_8UC3);
    default:
      for (int y = 0; y < height; ++y) {
        extractRow(layout, rows + y * stride, width, grey + static_cast<std::ptrdiff_t>(y) * width);
      }
  }
}

}  // namespace waymark::capture
