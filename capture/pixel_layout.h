// Where the grey lies in what cameras deliver, and how it is taken out.
#pragma once

#include <cstddef>
#include <cstdint>

namespace waymark::capture {

enum class PixelLayout {
  kGrey8,       // one byte a pixel, row after row; colour planes may follow
  kGreyEven,    // of each two bytes the first: YUYV
  kGreyOdd,     // of each two bytes the second: UYVY
  kGrey10,      // 16-bit little-endian words, of which the lowest 10 bits count
  kGrey12,      // the lowest 12
  kGrey16,      // all
  kBayerBGGR8,  // one byte a pixel behind a colour filter; named by the first two rows
  kBayerGBRG8,
  kBayerGRBG8,
  kBayerRGGB8,
  kRgb24,  // three bytes a pixel, red first
  kBgr24,  // blue first
  kJpeg,   // one compressed picture
};

// Bytes in a row of `width` pixels; 0 for kJpeg, which has no rows.
[[nodiscard]] std::size_t bytesPerRow(PixelLayout layout, int width);

// True where the camera's own bytes are the picture and nothing needs to be taken out of them.
[[nodiscard]] constexpr bool isGreyPlane(PixelLayout layout) {
  return layout == PixelLayout::kGrey8;
}

// Takes the grey out of height rows of `stride` bytes into grey[height][width], without gaps.
// Words are reduced to their highest 8 bits; colours, interpolated behind a Bayer filter, are
// weighted as in grey pictures. Precondition: layout != kJpeg, and each of the rows is there whole.
void extractGrey(PixelLayout layout, const std::uint8_t* rows, std::ptrdiff_t stride, int width,
                 int height, std::uint8_t* grey);

}  // namespace waymark::capture
