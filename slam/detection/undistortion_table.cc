#include "slam/detection/undistortion_table.h"

#include <limits>

namespace waymark::slam {

UndistortionTable::UndistortionTable(const CameraModel& camera) : width_(camera.width()) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  table_.reserve(static_cast<std::size_t>(camera.width()) *
                 static_cast<std::size_t>(camera.height()));
  for (int y = 0; y < camera.height(); ++y) {
    for (int x = 0; x < camera.width(); ++x) {
      const auto n = camera.undistort({static_cast<double>(x), static_cast<double>(y)});
      table_.emplace_back(n ? n->cast<float>() : Eigen::Vector2f(kNone, kNone));
    }
  }
}

}  // namespace waymark::slam
