#include "tools/diagnosis/grey_image.h"

#include <algorithm>

namespace waymark::diagnosis {

GreyImage copyOf(const ImageView& image) {
  GreyImage copy{image.width, image.height, {}};
  copy.pixels.reserve(static_cast<std::size_t>(image.width) *
                      static_cast<std::size_t>(image.height));
  for (int y = 0; y < image.height; ++y) {
    copy.pixels.insert(copy.pixels.end(), image.row(y), image.row(y) + image.width);
  }
  return copy;
}

GreyImage mirrored(const ImageView& image) {
  GreyImage copy = copyOf(image);
  for (auto row = copy.pixels.begin(); row != copy.pixels.end(); row += copy.width) {
    std::reverse(row, row + copy.width);
  }
  return copy;
}

GreyImage inverted(const ImageView& image) {
  GreyImage copy = copyOf(image);
  for (std::uint8_t& pixel : copy.pixels) pixel = static_cast<std::uint8_t>(255 - pixel);
  return copy;
}

void ImageSamples::add(const ImageView& image) {
  const bool taken = seen_ % every_ == 0;
  ++seen_;
  if (!taken || image.empty()) return;
  if (images_.size() + 1 >= 2 * wanted_) {
    // The first, third, fifth, ... stay.
    std::vector<GreyImage> half;
    for (std::size_t i = 0; i < images_.size(); i += 2) half.push_back(std::move(images_[i]));
    images_ = std::move(half);
    every_ *= 2;
    if ((seen_ - 1) % every_ != 0) return;
  }
  images_.push_back(copyOf(image));
}

}  // namespace waymark::diagnosis
