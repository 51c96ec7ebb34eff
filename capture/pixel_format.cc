#include "capture/pixel_format.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>

#include <linux/videodev2.h>

namespace waymark::capture {
namespace {

enum Cost { kAsItLies, kCopy, kWeigh, kDecode };

// The M variants have their colours in memory of their own; the grey lies alike.
constexpr std::array kFormats = {
    PixelFormat{V4L2_PIX_FMT_GREY, PixelLayout::kGrey8, kAsItLies},
    PixelFormat{V4L2_PIX_FMT_NV12, PixelLayout::kGrey8, kAsItLies},
    PixelFormat{V4L2_PIX_FMT_NV21, PixelLayout::kGrey8, kAsItLies},
    PixelFormat{V4L2_PIX_FMT_YUV420, PixelLayout::kGrey8, kAsItLies},
    PixelFormat{V4L2_PIX_FMT_YVU420, PixelLayout::kGrey8, kAsItLies},
    PixelFormat{V4L2_PIX_FMT_NV12M, PixelLayout::kGrey8, kAsItLies},
    PixelFormat{V4L2_PIX_FMT_NV21M, PixelLayout::kGrey8, kAsItLies},
    PixelFormat{V4L2_PIX_FMT_YUV420M, PixelLayout::kGrey8, kAsItLies},
    PixelFormat{V4L2_PIX_FMT_YUYV, PixelLayout::kGreyEven, kCopy},
    PixelFormat{V4L2_PIX_FMT_UYVY, PixelLayout::kGreyOdd, kCopy},
    PixelFormat{V4L2_PIX_FMT_Y10, PixelLayout::kGrey10, kCopy},
    PixelFormat{V4L2_PIX_FMT_Y12, PixelLayout::kGrey12, kCopy},
    PixelFormat{V4L2_PIX_FMT_Y16, PixelLayout::kGrey16, kCopy},
    PixelFormat{V4L2_PIX_FMT_SBGGR8, PixelLayout::kBayerBGGR8, kWeigh},
    PixelFormat{V4L2_PIX_FMT_SGBRG8, PixelLayout::kBayerGBRG8, kWeigh},
    PixelFormat{V4L2_PIX_FMT_SGRBG8, PixelLayout::kBayerGRBG8, kWeigh},
    PixelFormat{V4L2_PIX_FMT_SRGGB8, PixelLayout::kBayerRGGB8, kWeigh},
    PixelFormat{V4L2_PIX_FMT_RGB24, PixelLayout::kRgb24, kWeigh},
    PixelFormat{V4L2_PIX_FMT_BGR24, PixelLayout::kBgr24, kWeigh},
    PixelFormat{V4L2_PIX_FMT_MJPEG, PixelLayout::kJpeg, kDecode},
    PixelFormat{V4L2_PIX_FMT_JPEG, PixelLayout::kJpeg, kDecode},
};

std::string inCapitals(std::string text) {
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return std::toupper(c); });
  return text;
}

}  // namespace

const PixelFormat* findPixelFormat(std::uint32_t fourcc) {
  const auto* const found = std::ranges::find(kFormats, fourcc, &PixelFormat::fourcc);
  return found == kFormats.end() ? nullptr : found;
}

std::string fourccText(std::uint32_t fourcc) {
  std::string text;
  for (unsigned shift = 0; shift < 32; shift += 8) {
    const auto c = static_cast<char>((fourcc >> shift) & 0x7fU);
    text += std::isprint(static_cast<unsigned char>(c)) != 0 ? c : '?';
  }
  text.erase(text.find_last_not_of(' ') + 1);
  return text;
}

std::optional<std::uint32_t> readFourcc(const std::string& text) {
  const std::string wanted = inCapitals(text) == "MJPEG" ? "MJPG" : inCapitals(text);
  for (const PixelFormat& format : kFormats) {
    if (fourccText(format.fourcc) == wanted) return format.fourcc;
  }
  return {};
}

std::string knownFormats() {
  std::string text;
  for (const PixelFormat& format : kFormats) {
    text += (text.empty() ? "" : ", ") + fourccText(format.fourcc);
  }
  return text;
}

}  // namespace waymark::capture
