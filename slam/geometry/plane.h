// Small things about points in a plane.
#pragma once

#include <array>

#include <Eigen/Core>

namespace waymark::slam {

// Twice the area that a and b span: positive when b is clockwise of a in an image (y down).
[[nodiscard]] inline double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

[[nodiscard]] inline Eigen::Vector2d centreOf(const std::array<Eigen::Vector2d, 4>& corners) {
  return 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
}

}  // namespace waymark::slam
