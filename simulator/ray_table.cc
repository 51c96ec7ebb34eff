#include "simulator/ray_table.h"

#include <algorithm>
#include <optional>
#include <string>

namespace waymark::simulator {

Result<RayTable> RayTable::create(const slam::CameraModel& camera, int margin_px) {
  RayTable table;
  table.margin_ = margin_px;
  table.width_ = camera.width() + 2 * margin_px;
  table.height_ = camera.height() + 2 * margin_px;
  table.x_.reserve(table.offset(table.height_));
  table.y_.reserve(table.offset(table.height_));
  for (int row = -margin_px; row < camera.height() + margin_px; ++row) {
    for (int column = -margin_px; column < camera.width() + margin_px; ++column) {
      const std::optional<Eigen::Vector2d> ray = camera.undistort({column, row});
      if (!ray) {
        return Error{"the lens does not cover pixel (" + std::to_string(column) + ", " +
                     std::to_string(row) + ")"};
      }
      table.x_.push_back(static_cast<float>(ray->x()));
      table.y_.push_back(static_cast<float>(ray->y()));
    }
  }
  const auto [x_low, x_high] = std::minmax_element(table.x_.begin(), table.x_.end());
  const auto [y_low, y_high] = std::minmax_element(table.y_.begin(), table.y_.end());
  table.bounds_ = {*x_low, *x_high, *y_low, *y_high};
  return table;
}

}  // namespace waymark::simulator
