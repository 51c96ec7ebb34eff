#include "slam/detection/search/reduced_image.h"

#include <cstddef>
#include <cstring>
#include <utility>

#include "base/vectorized.h"

namespace waymark::slam {
namespace {

// The two pixels in the middle of each two or four of two rows: the inner bytes of words, in
// whatever order the machine loads them.
using ReduceRows = void (*)(const std::uint8_t* above, const std::uint8_t* below, int width,
                            std::uint8_t* out);

WAYMARK_VECTORIZED void halveRows(const std::uint8_t* above, const std::uint8_t* below, int width,
                                  std::uint8_t* out) {
  for (int x = 0; x < width; ++x) {
    std::uint16_t a = 0;
    std::uint16_t b = 0;
    std::memcpy(&a, above + std::ptrdiff_t{2} * x, 2);
    std::memcpy(&b, below + std::ptrdiff_t{2} * x, 2);
    const int sum = (a & 0xFF) + (a >> 8) + (b & 0xFF) + (b >> 8);
    out[x] = static_cast<std::uint8_t>((sum + 2) >> 2);
  }
}

WAYMARK_VECTORIZED void quarterRows(const std::uint8_t* above, const std::uint8_t* below, int width,
                                    std::uint8_t* out) {
  for (int x = 0; x < width; ++x) {
    std::uint32_t a = 0;
    std::uint32_t b = 0;
    std::memcpy(&a, above + std::ptrdiff_t{4} * x, 4);
    std::memcpy(&b, below + std::ptrdiff_t{4} * x, 4);
    const std::uint32_t sum =
        ((a >> 8U) & 0xFFU) + ((a >> 16U) & 0xFFU) + ((b >> 8U) & 0xFFU) + ((b >> 16U) & 0xFFU);
    out[x] = static_cast<std::uint8_t>((sum + 2U) >> 2U);
  }
}

// factor: that of reduce_rows, 2 or 4.
ImageView reduceBy(int factor, ReduceRows reduce_rows, const ImageView& image,
                   std::vector<std::uint8_t>* out) {
  const int width = image.width / factor;
  const int height = image.height / factor;
  out->resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y) {
    const int below = factor * y + factor / 2;  // of the two rows in the middle
    reduce_rows(image.row(below - 1), image.row(below), width,
                out->data() + std::ptrdiff_t{y} * width);
  }
  return {out->data(), width, height, width};
}

}  // namespace

ImageView ImageReducer::reduce(const ImageView& image, int factor) {
  if (factor == 2) return reduceBy(2, halveRows, image, &reduced_);
  ImageView view = reduceBy(4, quarterRows, image, &reduced_);
  for (factor /= 4; factor > 1; factor /= 2) {
    std::swap(reduced_, former_);
    view = reduceBy(2, halveRows, view, &reduced_);
  }
  return view;
}

}  // namespace waymark::slam
