// How fast the image of a point moves, and when the rows of an image are read.
#pragma once

#include "slam/geometry/reprojection.h"
#include "slam/geometry/twist.h"

namespace waymark::slam {

// Of a point in the camera frame, in normalized coordinates per second. Precondition: p_c.z() > 0.
[[nodiscard]] inline Eigen::Vector2d imageVelocity(const Eigen::Vector3d& p_c, const Twist& twist) {
  const Eigen::Vector3d velocity = -twist.head<3>() - twist.tail<3>().cross(p_c);
  const double iz = 1.0 / p_c.z();
  return iz * (velocity.head<2>() - velocity.z() * iz * p_c.head<2>());
}

// The same by the twist: the image's velocity is this times the twist.
[[nodiscard]] inline Matrix26d imageVelocityJacobian(const Eigen::Vector3d& p_c) {
  const double iz = 1.0 / p_c.z();
  const Eigen::Vector2d n = iz * p_c.head<2>();
  Matrix26d J;
  J << -iz, 0.0, n.x() * iz, n.x() * n.y(), -(1.0 + n.x() * n.x()), n.y(),  //
      0.0, -iz, n.y() * iz, 1.0 + n.y() * n.y(), -n.x() * n.y(), -n.x();
  return J;
}

// Time of a pixel row from the middle row's, in parts of the readout time: -0.5 to 0.5.
[[nodiscard]] inline double rowTime(double row_px, int height_px) {
  return row_px / (height_px - 1) - 0.5;
}

}  // namespace waymark::slam
