// The pixel formats of V4L2 that grey can be had from.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "capture/pixel_layout.h"

namespace waymark::capture {

struct PixelFormat {
  std::uint32_t fourcc;
  PixelLayout layout;
  // Cost of a picture, cheapest first: 0 is used as it lies, then copies, words, decoding.
  int cost;
};

// Null for formats that we cannot read.
[[nodiscard]] const PixelFormat* findPixelFormat(std::uint32_t fourcc);

// "YUYV", as users type it; "Y10 " without the blank. Unprintable bytes become '?'.
[[nodiscard]] std::string fourccText(std::uint32_t fourcc);

// The other way: 1 to 4 characters, in capitals or not. Empty when that is no format we can read.
[[nodiscard]] std::optional<std::uint32_t> readFourcc(const std::string& text);

// "GREY, NV12, ...": all of them, for messages.
[[nodiscard]] std::string knownFormats();

}  // namespace waymark::capture
