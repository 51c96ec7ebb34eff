// The mean of poses.
#pragma once

#include <span>

#include <Eigen/Core>

#include "slam/geometry/transform.h"

namespace waymark::slam {

// The rotation that minimizes the sum of squared chordal distances. Precondition: not empty.
[[nodiscard]] Eigen::Matrix3d meanRotation(std::span<const Eigen::Matrix3d> rotations);
// That, and the mean of the positions. Precondition: not empty.
[[nodiscard]] Transform meanTransform(std::span<const Transform> transforms);

}  // namespace waymark::slam
