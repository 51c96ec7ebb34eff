#include "slam/natural/pictures/grey_pyramid.h"

#include <type_traits>
#include <utility>

namespace waymark::slam {
namespace {

template <typename Grey>
Grey meanOfFour(Grey a, Grey b, Grey c, Grey d) {
  if constexpr (std::is_floating_point_v<Grey>)
    return Grey{0.25} * (a + b + c + d);
  else
    return static_cast<Grey>((a + b + c + d + 2) / 4);
}

template <typename Grey>
GreyImage<Grey> halved(const GreyImage<Grey>& from) {
  GreyImage<Grey> to{from.width / 2, from.height / 2, {}};
  to.grey.resize(static_cast<std::size_t>(to.width) * static_cast<std::size_t>(to.height));
  for (int y = 0; y < to.height; ++y) {
    const Grey* a = from.row(2 * y);
    const Grey* b = from.row(2 * y + 1);
    Grey* out = to.row(y);
    for (int x = 0; x < to.width; ++x) {
      out[x] = meanOfFour(a[2 * x], a[2 * x + 1], b[2 * x], b[2 * x + 1]);
    }
  }
  return to;
}

}  // namespace

template <typename Grey>
GreyPyramidOf<Grey>::GreyPyramidOf(ImageView image, int min_side_px) {
  GreyImage<Grey> full{image.width, image.height, {}};
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

template class GreyPyramidOf<float>;
template class GreyPyramidOf<std::uint8_t>;

}  // namespace waymark::slam
