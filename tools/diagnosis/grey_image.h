// A grey image of its own, and a handful of them spread over a recording of any length.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/image_view.h"

namespace waymark::diagnosis {

struct GreyImage {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> pixels;  // row after row

  [[nodiscard]] ImageView view() const { return {pixels.data(), width, height, width}; }
};

[[nodiscard]] GreyImage copyOf(const ImageView& image);
// Left and right exchanged, as some cameras send themselves.
[[nodiscard]] GreyImage mirrored(const ImageView& image);
// White is black.
[[nodiscard]] GreyImage inverted(const ImageView& image);

// Keeps few images of many, evenly spread however many there will be: whenever there are twice as
// many as wanted, every second one goes, and from then on fewer are taken.
class ImageSamples {
 public:
  // wanted: at least so many are kept where there are as many, and less than twice as many.
  explicit ImageSamples(std::size_t wanted = 8) : wanted_(wanted) {}

  void add(const ImageView& image);
  [[nodiscard]] const std::vector<GreyImage>& images() const { return images_; }

 private:
  std::size_t wanted_;
  std::size_t every_ = 1;
  std::size_t seen_ = 0;
  std::vector<GreyImage> images_;
};

}  // namespace waymark::diagnosis
