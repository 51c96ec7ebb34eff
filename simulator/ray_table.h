// The direction each pixel looks in, undistorted once per camera.
#pragma once

#include <cstddef>
#include <vector>

#include "base/result.h"
#include "slam/geometry/camera_model.h"

namespace waymark::simulator {

// Normalized coordinates (x, y at z = 1) of the pixel centres, with `margin` more pixels on each
// side of the image: row and column 0 are at pixel (-margin, -margin). Floats hold a direction to
// about 0.0001 px.
class RayTable {
 public:
  // An Error when some pixel has no direction (a lens that does not cover the image).
  [[nodiscard]] static Result<RayTable> create(const slam::CameraModel& camera, int margin_px);

  [[nodiscard]] int width() const { return width_; }    // with margins
  [[nodiscard]] int height() const { return height_; }  // with margins
  [[nodiscard]] int margin() const { return margin_; }
  [[nodiscard]] const float* x(int row) const { return x_.data() + offset(row); }
  [[nodiscard]] const float* y(int row) const { return y_.data() + offset(row); }

  // The smallest box of normalized coordinates around all of them.
  struct Bounds {
    float x_low, x_high, y_low, y_high;
  };
  [[nodiscard]] const Bounds& bounds() const { return bounds_; }

 private:
  RayTable() = default;
  [[nodiscard]] std::size_t offset(int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(width_);
  }

  int width_ = 0;
  int height_ = 0;
  int margin_ = 0;
  std::vector<float> x_;
  std::vector<float> y_;
  Bounds bounds_{};
};

}  // namespace waymark::simulator
