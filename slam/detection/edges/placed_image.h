// An image, and where its pixels are in the camera's.
#pragma once

#include <Eigen/Core>

#include "base/image_view.h"

namespace waymark::slam {

// The camera's own image, or a part of it at 1/factor of its size.
struct PlacedImage {
  // Implicit: most images are the camera's.
  PlacedImage(const ImageView& camera_image) : image(camera_image) {}  // NOLINT(*-explicit-*)
  PlacedImage(const ImageView& part, const Eigen::Vector2d& origin_px_, int factor_)
      : image(part), origin_px(origin_px_), factor(factor_) {}

  [[nodiscard]] Eigen::Vector2d fromCamera(const Eigen::Vector2d& pixel) const {
    return (pixel - origin_px) / factor;
  }

  ImageView image;
  Eigen::Vector2d origin_px = Eigen::Vector2d::Zero();  // of its first pixel, in the camera's image
  int factor = 1;
};

}  // namespace waymark::slam
