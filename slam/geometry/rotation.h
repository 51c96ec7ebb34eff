// A rotation whose instantiation costs the compiler ten seconds, in one place.
#pragma once

#include <Eigen/Core>

namespace waymark::slam {

// The smallest rotation that takes one direction to another; of opposite ones, any of the smallest.
// Precondition: neither is zero.
[[nodiscard]] Eigen::Matrix3d rotationBetween(const Eigen::Vector3d& from,
                                              const Eigen::Vector3d& to);

}  // namespace waymark::slam
