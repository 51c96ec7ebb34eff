// The undistorted (normalised) coordinates of every pixel, computed once per camera.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "slam/geometry/camera_model.h"

namespace waymark::slam {

class UndistortionTable {
 public:
  explicit UndistortionTable(const CameraModel& camera);

  // Precondition: 0 <= x < width, 0 <= y < height. NaN where the lens model has no inverse.
  [[nodiscard]] const Eigen::Vector2f& at(int x, int y) const {
    return table_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
                  static_cast<std::size_t>(x)];
  }

 private:
  int width_;
  std::vector<Eigen::Vector2f> table_;
};

}  // namespace waymark::slam
