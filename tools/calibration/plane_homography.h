// The homography from a flat board into an image, from any number of points.
#pragma once

#include <optional>
#include <span>

#include <Eigen/Core>

namespace waymark::calibration {

// H maps (x, y, 1) of `from` to `to`, least squares by the normalized direct linear transformation.
// Empty for fewer than four points, or where they lie on a line.
[[nodiscard]] std::optional<Eigen::Matrix3d> fitHomography(std::span<const Eigen::Vector2d> from,
                                                           std::span<const Eigen::Vector2d> to);

}  // namespace waymark::calibration
