#include "slam/natural/start_limits.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

double enclosed_px2(std::span<const Eigen::Vector2d> corners) {
  double twice = 0.0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector2d& a = corners[i];
    const Eigen::Vector2d& b = corners[(i + 1) % corners.size()];
    twice += a.x() * b.y() - b.x() * a.y();
  }
  return 0.5 * std::abs(twice);
}

}  // namespace

std::string StartLimits::invalidReason() const {
  return firstUnmet({{border >= 0.0 && border < 0.5, "the border is from 0 to below 0.5"},
                     {min_area >= 0.0 && min_area < max_area && max_area <= 1.0,
                      "the areas are from 0 to 1, the least one below the largest"}});
}

bool isWithin(const StartLimits& limits, std::span<const Eigen::Vector2d> corners_px, int width,
              int height) {
  const double area = enclosed_px2(corners_px) / (static_cast<double>(width) * height);
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
