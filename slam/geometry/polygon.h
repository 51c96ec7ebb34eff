// Polygons in the plane.
#pragma once

#include <cmath>
#include <cstddef>
#include <span>

#include <Eigen/Core>

namespace waymark::slam {

// What the corners, in turn either way round, enclose; in their unit squared.
[[nodiscard]] inline double polygonArea(std::span<const Eigen::Vector2d> corners) {
  double twice = 0.0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Eigen::Vector2d& a = corners[i];
    const Eigen::Vector2d& b = corners[(i + 1) % corners.size()];
    twice += a.x() * b.y() - b.x() * a.y();
  }
  return 0.5 * std::abs(twice);
}

// Of the sides between corners in turn; in their unit. Precondition: there are corners.
[[nodiscard]] inline double meanSide(std::span<const Eigen::Vector2d> corners) {
  double length = 0.0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    length += (corners[(i + 1) % corners.size()] - corners[i]).norm();
  }
  return length / static_cast<double>(corners.size());
}

}  // namespace waymark::slam
