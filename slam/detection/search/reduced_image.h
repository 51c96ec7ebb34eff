// An image at a fraction of its size.
#pragma once

#include <cstdint>
#include <vector>

#include "base/image_view.h"

namespace waymark::slam {

class ImageReducer {
 public:
  // 1/factor of the size: a power of two, at least 2. Pixels are means of four: at half the size of
  // all that there are, at a quarter of those in the middle of each square, and so on by halves.
  // What does not fill a square at the right or at the bottom is left out. Valid until the next
  // call.
  ImageView reduce(const ImageView& image, int factor);

 private:
  std::vector<std::uint8_t> reduced_;
  std::vector<std::uint8_t> former_;
};

}  // namespace waymark::slam
