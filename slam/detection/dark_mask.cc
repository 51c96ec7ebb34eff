#include "slam/detection/dark_mask.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/vectorised.h"

namespace waymark::slam {
namespace {

constexpr int kWindow = 16;
constexpr int kBefore = 8;  // of the window's rows and columns before the pixel

// Adds a row to the columns' sums and takes another away.
WAYMARK_VECTORISED void slide(const std::uint8_t* in, const std::uint8_t* out, int width,
                              std::uint16_t* column) {
  for (int x = 0; x < width; ++x) {
    column[x] = static_cast<std::uint16_t>(column[x] + in[x] - out[x]);
  }
}

// sums[x] = the 16 columns from x on, in sums of 2, 4, 8 and 16 of them. `sums` has room for as
// many columns, 15 more than width.
WAYMARK_VECTORISED void sumWindows(const std::uint16_t* column, int width, std::uint16_t* sums) {
  const int all = width + kWindow - 1;
  for (int x = 0; x < all - 1; ++x) sums[x] = static_cast<std::uint16_t>(column[x] + column[x + 1]);
  for (int x = 0; x < all - 3; ++x) sums[x] = static_cast<std::uint16_t>(sums[x] + sums[x + 2]);
  for (int x = 0; x < all - 7; ++x) sums[x] = static_cast<std::uint16_t>(sums[x] + sums[x + 4]);
  for (int x = 0; x < all - 15; ++x) sums[x] = static_cast<std::uint16_t>(sums[x] + sums[x + 8]);
}

// 1 where a pixel is dark.
WAYMARK_VECTORISED void flagDark(const std::uint8_t* grey, const std::uint16_t* sums, int width,
                                 std::uint16_t factor, std::uint16_t offset, std::uint8_t* flags) {
  for (int x = 0; x < width; ++x) {
    const std::uint32_t product = static_cast<std::uint32_t>(sums[x]) * factor;
    const auto level = static_cast<std::uint16_t>(product >> 16U);
    flags[x] = static_cast<std::uint16_t>(grey[x] + offset) < level ? 1 : 0;
  }
}

// Eight flags to eight bits: each product brings flag i to bit 56 + i.
void pack(const std::uint8_t* flags, int words, std::uint64_t* bits) {
  for (std::ptrdiff_t w = 0; w < words; ++w) {
    std::uint64_t word = 0;
    for (std::ptrdiff_t k = 0; k < 8; ++k) {
      std::uint64_t eight = 0;
      std::memcpy(&eight, flags + 64 * w + 8 * k, 8);
      word |= (eight * 0x0102040810204080U >> 56U) << static_cast<unsigned>(8 * k);
    }
    bits[w] = word;
  }
}

void dropSpecks(const DarkMask& raw, DarkMask* mask) {
  const int words = raw.wordsPerRow();
  for (int y = 0; y < raw.height(); ++y) {
    const std::uint64_t* const here = raw.row(y);
    const std::uint64_t* const above = y > 0 ? raw.row(y - 1) : nullptr;
    const std::uint64_t* const below = y + 1 < raw.height() ? raw.row(y + 1) : nullptr;
    std::uint64_t* const out = mask->row(y);
    for (int w = 0; w < words; ++w) {
      const std::uint64_t left = here[w] << 1U | (w > 0 ? here[w - 1] >> 63U : 0U);
      const std::uint64_t right = here[w] >> 1U | (w + 1 < words ? here[w + 1] << 63U : 0U);
      const std::uint64_t over = above != nullptr ? above[w] : 0U;
      const std::uint64_t under = below != nullptr ? below[w] : 0U;
      out[w] = here[w] & (left | right) & (over | under);
    }
  }
}

}  // namespace

void DarkMask::resize(int width, int height) {
  width_ = width;
  height_ = height;
  words_per_row_ = (width + 63) / 64;
  bits_.assign(static_cast<std::size_t>(words_per_row_) * static_cast<std::size_t>(height), 0);
}

DarkMaskMaker::DarkMaskMaker(std::span<const DarkMaskOptions> thresholds)
    : masks_(thresholds.size()) {
  for (const DarkMaskOptions& options : thresholds) {
    const double factor = 65536.0 * (1.0 - options.share) / (kWindow * kWindow);
    thresholds_.push_back({static_cast<std::uint16_t>(std::lround(factor)),
                           static_cast<std::uint16_t>(std::lround(options.offset)),
                           {}});
  }
}

void DarkMaskMaker::resize(int width, int height) {
  if (width == width_ && height == height_) return;
  width_ = width;
  height_ = height;
  for (Threshold& threshold : thresholds_) threshold.raw.resize(width, height);
  for (DarkMask& mask : masks_) mask.resize(width, height);
  column_.assign(static_cast<std::size_t>(width) + std::size_t{2 * kWindow}, 0);
  window_.assign(static_cast<std::size_t>(width) + std::size_t{kWindow}, 0);
  flags_.assign(64 * static_cast<std::size_t>((width + 63) / 64), 0);
}

std::span<const DarkMask> DarkMaskMaker::make(const ImageView& image) {
  resize(image.width, image.height);
  // Beyond the image its outermost rows and columns go on.
  const auto rowNear = [&](int y) { return image.row(std::clamp(y, 0, height_ - 1)); };
  std::uint16_t* const column = column_.data() + kWindow;
  std::fill(column_.begin(), column_.end(), std::uint16_t{0});
  for (int y = -kBefore; y < kWindow - kBefore; ++y) {
    const std::uint8_t* row = rowNear(y);
    for (int x = 0; x < width_; ++x) column[x] = static_cast<std::uint16_t>(column[x] + row[x]);
  }
  for (int y = 0; y < height_; ++y) {
    if (y > 0) slide(rowNear(y + kWindow - kBefore - 1), rowNear(y - kBefore - 1), width_, column);
    std::fill_n(column - kBefore, kBefore, column[0]);
    std::fill_n(column + width_, kWindow, column[width_ - 1]);
    sumWindows(column - kBefore, width_, window_.data());
    for (Threshold& threshold : thresholds_) {
      flagDark(image.row(y), window_.data(), width_, threshold.factor, threshold.offset,
               flags_.data());
      pack(flags_.data(), threshold.raw.wordsPerRow(), threshold.raw.row(y));
    }
  }
  for (std::size_t i = 0; i < masks_.size(); ++i) dropSpecks(thresholds_[i].raw, &masks_[i]);
  return masks_;
}

}  // namespace waymark::slam
