// Which pixels are dark against their surroundings: the adaptive threshold that the full scan
// starts from.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/image_view.h"

namespace waymark::slam {

struct DarkMaskOptions {
  // A pixel is dark below mean * (1 - share) - offset of the 16 x 16 window around it and the pixel
  // below it (above it, in odd rows): the share goes with the light on the scene, the offset (grey
  // levels) with the sensor's noise. Larger values separate squares that touch and are deaf to
  // faint prints.
  double share = 0.07;
  double offset = 4.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// One bit a pixel, in rows of whole words: pixel x is bit x % 64 of word x / 64, and bits beyond
// the width are zero.
class DarkMask {
 public:
  // Changes the size only; what the bits are then is not said.
  void resize(int width, int height);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] int wordsPerRow() const { return static_cast<int>(words_per_row_); }
  [[nodiscard]] const std::uint64_t* row(int y) const { return bits_.data() + y * words_per_row_; }
  [[nodiscard]] std::uint64_t* row(int y) { return bits_.data() + y * words_per_row_; }
  // How many runs of dark pixels its rows have, all together: how long a look at them takes.
  [[nodiscard]] int countRuns() const;
  [[nodiscard]] bool dark(int x, int y) const { return ((row(y)[x / 64] >> (x % 64)) & 1U) != 0; }

 private:
  int width_ = 0;
  int height_ = 0;
  std::ptrdiff_t words_per_row_ = 0;
  std::vector<std::uint64_t> bits_;
};

// Makes masks of an image, one for each of some thresholds; what they share is done once.
class DarkMaskMaker {
 public:
  explicit DarkMaskMaker(std::span<const DarkMaskOptions> thresholds);

  // In the order of the thresholds; valid until the next call. A dark pixel without a dark
  // neighbour in its row, or in its column, is noise and left out.
  std::span<const DarkMask> make(const ImageView& image);

 private:
  struct Threshold {
    std::uint16_t factor;  // of the window's sum, in 1/65536: gives the level without the offset
    std::uint16_t offset;
    DarkMask raw;  // with the specks
  };

  void resize(int width, int height);

  std::vector<Threshold> thresholds_;
  std::vector<DarkMask> masks_;
  int width_ = 0;
  int height_ = 0;
  std::vector<std::uint16_t> column_;  // sums over the window's rows, padded
  std::vector<std::uint16_t> fours_;   // sums over four of its columns
  std::vector<std::uint16_t> window_;  // sums over the whole window
  std::vector<std::uint8_t> flags_;    // of a row, one byte a pixel
};

}  // namespace waymark::slam
