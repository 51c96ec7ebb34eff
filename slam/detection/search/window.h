// A part of an image.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include <Eigen/Core>

#include "base/image_view.h"

namespace waymark::slam {

// Pixels.
struct Window {
  int left = 0;
  int top = 0;
  int width = 0;
  int height = 0;
};

// A part that is to be searched.
struct SearchRegion {
  Window window;   // of the whole image
  int factor = 1;  // searched at 1/factor of its size
  // Larger things, in pixels at that size, are left to coarser searches; 0: nothing is.
  int max_px = 0;
  // How often it was searched before: of too many things there, others have their turn each time.
  std::uint32_t turn = 0;
};

// At the size it is searched at.
[[nodiscard]] inline double searchedPixels(const SearchRegion& region) {
  return static_cast<double>(region.window.width) * region.window.height /
         (region.factor * region.factor);
}

[[nodiscard]] inline ImageView partOf(const ImageView& image, const Window& window) {
  return {image.row(window.top) + window.left, window.width, window.height, image.stride};
}

// What the image has of a quad (pixels) and a margin around it. Nothing (width or height 0) where
// the quad is outside.
[[nodiscard]] inline Window windowAround(const std::array<Eigen::Vector2d, 4>& quad, int margin_px,
                                         const ImageView& image) {
  Eigen::Vector2d least = quad[0];
  Eigen::Vector2d most = quad[0];
  for (const Eigen::Vector2d& corner : quad) {
    least = least.cwiseMin(corner);
    most = most.cwiseMax(corner);
  }
  const Eigen::Vector2d size(image.width, image.height);
  const Eigen::Vector2d margin = Eigen::Vector2d::Constant(margin_px);
  const Eigen::Vector2i low =
      (least - margin).cwiseMax(0.0).cwiseMin(size).array().floor().cast<int>();
  const Eigen::Vector2i high =
      (most + margin).cwiseMax(0.0).cwiseMin(size).array().ceil().cast<int>();
  return {low.x(), low.y(), high.x() - low.x(), high.y() - low.y()};
}

}  // namespace waymark::slam
