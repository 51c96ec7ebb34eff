// Images as OpenCV has them, and the other way round; nothing is copied.
#pragma once

#include <cstddef>
#include <cstdint>

#include <opencv2/core.hpp>

#include "base/image_view.h"

namespace waymark::slam {

// OpenCV knows no constant images: nobody writes to it.
[[nodiscard]] inline cv::Mat matOf(ImageView image) {
  return {image.height, image.width, CV_8U, const_cast<std::uint8_t*>(image.data),
          static_cast<std::size_t>(image.stride)};
}

[[nodiscard]] inline ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, static_cast<std::ptrdiff_t>(image.step)};
}

}  // namespace waymark::slam
