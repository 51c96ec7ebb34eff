// The direction each pixel of a camera looks in, undistorted where it is first asked for.
#pragma once

#include <cstddef>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/camera_model.h"

namespace waymark::slam {

class PixelRays {
 public:
  explicit PixelRays(const CameraModel& camera) : camera_(camera) {
    const auto pixels =
        static_cast<std::size_t>(camera.width()) * static_cast<std::size_t>(camera.height());
    rays_.resize(pixels, Eigen::Vector2f::Zero());
    known_.resize(pixels, false);
  }

  [[nodiscard]] const CameraModel& camera() const { return camera_; }

  // Normalized coordinates of a pixel's centre; not a number where the lens has none.
  // Precondition: the pixel is in the image.
  [[nodiscard]] const Eigen::Vector2f& at(int x, int y) {
    const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(camera_.width()) +
                   static_cast<std::size_t>(x);
    if (!known_[i]) {
      known_[i] = true;
      const auto ray = camera_.undistort({x, y});
      constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
      rays_[i] = ray ? Eigen::Vector2f(ray->cast<float>()) : Eigen::Vector2f(kNone, kNone);
    }
    return rays_[i];
  }

  // Of a pixel of the image halved `level` times: between the four in its middle.
  [[nodiscard]] Eigen::Vector2f atLevel(int x, int y, int level) {
    if (level == 0) return at(x, y);
    const int half = 1 << (level - 1);
    const int right = (x << level) + half;
    const int low = (y << level) + half;
    return 0.25F *
           (at(right - 1, low - 1) + at(right, low - 1) + at(right - 1, low) + at(right, low));
  }

 private:
  CameraModel camera_;
  std::vector<Eigen::Vector2f> rays_;
  std::vector<bool> known_;
};

}  // namespace waymark::slam
