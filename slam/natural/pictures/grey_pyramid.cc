#include "slam/natural/pictures/grey_pyramid.h"

#include <utility>

namespace waymark::slam {
namespace {

GreyLevels halved(const GreyLevels& from) {
  GreyLevels to{from.width / 2, from.height / 2, {}};
  to.grey.resize(static_cast<std::size_t>(to.width) * static_cast<std::size_t>(to.height));
  for (int y = 0; y < to.height; ++y) {
    const float* a = from.row(2 * y);
    const float* b = from.row(2 * y + 1);
    float* out = to.row(y);
    for (int x = 0; x < to.width; ++x) {
      out[x] = 0.25F * (a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1]);
    }
  }
  return to;
}

}  // namespace

GreyPyramid::GreyPyramid(ImageView image, int min_side_px) {
  GreyLevels full{image.width, image.height, {}};
  full.grey.reserve(static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height));
  for (int y = 0; y < image.height; ++y) {
    const std::uint8_t* row = image.row(y);
    full.grey.insert(full.grey.end(), row, row + image.width);
  }
  levels_.push_back(std::move(full));
  while (std::min(levels_.back().width, levels_.back().height) / 2 >= std::max(2, min_side_px)) {
    levels_.push_back(halved(levels_.back()));
  }
}

}  // namespace waymark::slam
