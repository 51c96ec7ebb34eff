// Two sets of the same points, each in a frame of its own.
#pragma once

#include <span>

#include "slam/geometry/transform.h"

namespace waymark::slam {

// The rigid motion, without scale, that brings `from` onto `to` with the least squared distance
// (Horn). Where the points leave the rotation open (all on a line, one point), one of the best.
// Precondition: both have the same number of points, and that is not 0.
[[nodiscard]] Transform alignPoints(std::span<const Eigen::Vector3d> from,
                                    std::span<const Eigen::Vector3d> to);

}  // namespace waymark::slam
