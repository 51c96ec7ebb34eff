// Homography of the unit square onto a quadrilateral, in closed form.
#pragma once

#include <array>
#include <optional>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace waymark::slam {

// H maps (u, v, 1) of the unit square to the quad: (0,0) -> quad[0], (1,0) -> quad[1],
// (1,1) -> quad[2], (0,1) -> quad[3]; H(2,2) = 1. Empty for a degenerate quad.
[[nodiscard]] std::optional<Eigen::Matrix3d> homographyFromUnitSquare(
    const std::array<Eigen::Vector2d, 4>& quad);

[[nodiscard]] inline Eigen::Vector2d applyHomography(const Eigen::Matrix3d& H,
                                                     const Eigen::Vector2d& point) {
  const Eigen::Vector3d h = H * point.homogeneous();
  return h.head<2>() / h.z();
}

}  // namespace waymark::slam
