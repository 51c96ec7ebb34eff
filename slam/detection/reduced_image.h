// An image at a fraction of its size.
#pragma once

#include <cstdint>
#include <vector>

#include "base/image_view.h"

namespace waymark::slam {

class ImageReducer {
 public:
  // The image at half its size, and that at half of its own, until it is 1/factor of it: a power of
  // two, at least 2. Pixels are the means of squares; what does not fill one at the right or at the
  // bottom is left out. Valid until the next call.
  ImageView reduce(const ImageView& image, int factor);

 private:
  std::vector<std::uint8_t> reduced_;
  std::vector<std::uint8_t> former_;
};

}  // namespace waymark::slam
