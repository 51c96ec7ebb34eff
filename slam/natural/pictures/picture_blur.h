// How an image of a print is blurred: a covariance, pixels squared, of a lens's Gaussian and the
// way that the image moved while it was exposed.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "slam/natural/pictures/expected_picture.h"

namespace waymark::slam {

// Standard deviation in the direction in which it is largest, pixels.
[[nodiscard]] double widestBlur(const Eigen::Matrix2d& covariance);

// Both widths within the limits (standard deviations), the directions kept.
[[nodiscard]] Eigen::Matrix2d limitedBlur(const Eigen::Matrix2d& covariance, double least_sigma,
                                          double most_sigma);

// The expected grey levels, blurred. blur: pixels squared of the expected picture's level.
[[nodiscard]] std::vector<float> blurredPicture(const ExpectedPicture& expected,
                                                const Eigen::Matrix2d& blur);

}  // namespace waymark::slam
