#include "slam/detection/quads/dark_mask.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include "base/vectorized.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

constexpr int kWindow = 16;
constexpr int kBefore = 7;         // of the window's rows before the upper of two rows
constexpr int kColumnsBefore = 8;  // of its columns before the pixel

// Adds a row to the columns' sums.
WAYMARK_VECTORIZED void add(const std::uint8_t* in, int width, std::uint16_t* column) {
  for (int x = 0; x < width; ++x) column[x] = static_cast<std::uint16_t>(column[x] + in[x]);
}

// Adds two rows to the columns' sums and takes two others away.
WAYMARK_VECTORIZED void slide(const std::uint8_t* in_1, const std::uint8_t* in_2,
                              const std::uint8_t* out_1, const std::uint8_t* out_2, int width,
                              std::uint16_t* column) {
  for (int x = 0; x < width; ++x) {
    column[x] = static_cast<std::uint16_t>(column[x] + in_1[x] + in_2[x] - out_1[x] - out_2[x]);
  }
}

// sums[x] = the 16 columns from x on, by way of sums of four. `sums` and `fours` have room for as
// many columns, 15 more than width.
WAYMARK_VECTORIZED void sumWindows(const std::uint16_t* column, int width, std::uint16_t* fours,
                                   std::uint16_t* sums) {
  for (int x = 0; x < width + 12; ++x) {
    fours[x] =
        static_cast<std::uint16_t>(column[x] + column[x + 1] + column[x + 2] + column[x + 3]);
  }
  for (int x = 0; x < width; ++x) {
    sums[x] = static_cast<std::uint16_t>(fours[x] + fours[x + 4] + fours[x + 8] + fours[x + 12]);
  }
}

// 1 where a pixel is dark.
WAYMARK_VECTORIZED void flagDark(const std::uint8_t* grey, const std::uint16_t* sums, int width,
                                 std::uint16_t factor, std::uint16_t offset, std::uint8_t* flags) {
  for (int x = 0; x < width; ++x) {
    const std::uint32_t product = static_cast<std::uint32_t>(sums[x]) * factor;
    const auto level = static_cast<std::uint16_t>(product >> 16U);
    flags[x] = static_cast<std::uint16_t>(grey[x] + offset) < level ? 1 : 0;
  }
}

// 64 flags to 64 bits.
std::uint64_t wordOf(const std::uint8_t* flags) {
  std::uint64_t word = 0;
#ifdef __SSE2__
  for (unsigned k = 0; k < 4; ++k) {
    const __m128i sixteen =
        _mm_loadu_si128(reinterpret_cast<const __m128i*>(flags + std::size_t{16} * k));
    const auto bits = static_cast<std::uint32_t>(_mm_movemask_epi8(_mm_slli_epi16(sixteen, 7)));
    word |= std::uint64_t{bits} << (16 * k);
  }
#else
  // Each product brings flag i of eight to bit 56 + i.
  for (unsigned k = 0; k < 8; ++k) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, flags + std::size_t{8} * k, 8);
    word |= (eight * 0x0102040810204080U >> 56U) << (8 * k);
  }
#endif
  return word;
}

void pack(const std::uint8_t* flags, int words, std::uint64_t* bits) {
  for (std::ptrdiff_t w = 0; w < words; ++w) bits[w] = wordOf(flags + 64 * w);
}

// Each begins with a dark pixel that has none to its left.
WAYMARK_VECTORIZED int countStarts(const std::uint64_t* row, int words) {
  int starts = 0;
  std::uint64_t last_bit = 0;
  for (std::ptrdiff_t w = 0; w < words; ++w) {
    starts += std::popcount(row[w] & ~(row[w] << 1U | last_bit));
    last_bit = row[w] >> 63U;
  }
  return starts;
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

std::string DarkMaskOptions::invalidReason() const {
  return firstUnmet({
      {share >= 0.0 && share < 1.0,
       "the share of a dark pixel's threshold must be 0 to less than 1"},
      {isNotNegative(offset), "the offset of a dark pixel's threshold must not be negative"},
  });
}

void DarkMask::resize(int width, int height) {
  width_ = width;
  height_ = height;
  words_per_row_ = (width + 63) / 64;
  bits_.resize(static_cast<std::size_t>(words_per_row_) * static_cast<std::size_t>(height));
}

int DarkMask::countRuns() const {
  int runs = 0;
  for (int y = 0; y < height_; ++y) runs += countStarts(row(y), wordsPerRow());
  return runs;
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
  column_.resize(static_cast<std::size_t>(width) + std::size_t{2 * kWindow});
  fours_.resize(static_cast<std::size_t>(width) + std::size_t{kWindow});
  window_.resize(static_cast<std::size_t>(width) + std::size_t{kWindow});
  // Those beyond the width stay zero.
  flags_.assign(64 * static_cast<std::size_t>((width + 63) / 64), 0);
}

// Two rows at a time: the windows around a pixel and around the one below it differ by little.
std::span<const DarkMask> DarkMaskMaker::make(const ImageView& image) {
  resize(image.width, image.height);
  // Beyond the image its outermost rows and columns go on.
  const auto rowNear = [&](int y) { return image.row(std::clamp(y, 0, height_ - 1)); };
  std::uint16_t* const column = column_.data() + kWindow;
  std::fill(column_.begin(), column_.end(), std::uint16_t{0});
  for (int y = -kBefore; y < kWindow - kBefore; ++y) add(rowNear(y), width_, column);
  for (int y = 0; y < height_; y += 2) {
    if (y > 0) {
      const int out = y - kBefore - 2;
      slide(rowNear(out + kWindow), rowNear(out + kWindow + 1), rowNear(out), rowNear(out + 1),
            width_, column);
    }
    std::fill_n(column - kColumnsBefore, kColumnsBefore, column[0]);
    std::fill_n(column + width_, kWindow, column[width_ - 1]);
    sumWindows(column - kColumnsBefore, width_, fours_.data(), window_.data());
    for (int row = y; row < std::min(y + 2, height_); ++row) {
      for (Threshold& threshold : thresholds_) {
        flagDark(image.row(row), window_.data(), width_, threshold.factor, threshold.offset,
                 flags_.data());
        pack(flags_.data(), threshold.raw.wordsPerRow(), threshold.raw.row(row));
      }
    }
  }
  for (std::size_t i = 0; i < masks_.size(); ++i) dropSpecks(thresholds_[i].raw, &masks_[i]);
  return masks_;
}

}  // namespace waymark::slam
