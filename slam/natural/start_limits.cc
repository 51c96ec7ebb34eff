#include "slam/natural/start_limits.h"

#include <algorithm>

#include "slam/geometry/polygon.h"
#include "slam/option_checks.h"

namespace waymark::slam {

std::string StartLimits::invalidReason() const {
  return firstUnmet({{border >= 0.0 && border < 0.5, "the border is from 0 to below 0.5"},
                     {min_area >= 0.0 && min_area < max_area && max_area <= 1.0,
                      "the areas are from 0 to 1, the least one below the largest"}});
}

bool isWithin(const StartLimits& limits, std::span<const Eigen::Vector2d> corners_px, int width,
              int height) {
  const double area = polygonArea(corners_px) / (static_cast<double>(width) * height);
  // What is nearer than the image is large reaches beyond it, and covers all of it.
  if (area < limits.min_area || std::min(area, 1.0) > limits.max_area) return false;
  if (limits.border == 0.0) return true;
  return std::ranges::all_of(corners_px, [&](const Eigen::Vector2d& corner) {
    const auto inside = [&](double at, int size) {
      return at >= limits.border * size && at <= (1.0 - limits.border) * size;
    };
    return inside(corner.x(), width) && inside(corner.y(), height);
  });
}

}  // namespace waymark::slam
