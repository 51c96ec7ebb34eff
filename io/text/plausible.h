// What numbers in files may be: far more than anything real needs, and little enough that squares,
// products and inverses of them still are numbers.
#pragma once

#include <cmath>

#include <Eigen/Core>

namespace waymark::io {

// Of a marker's side.
[[nodiscard]] inline bool isSize(double size_m) { return size_m >= 1e-4 && size_m <= 1e3; }
inline constexpr const char* kSizes = "must be from 0.0001 to 1000 m";

// Coordinates that count from the Earth's centre are below.
[[nodiscard]] inline bool isPosition(const Eigen::Vector3d& p_m) {
  return p_m.cwiseAbs().maxCoeff() <= 1e8;
}
inline constexpr const char* kPositions = "is farther away than 100000 km";

// Of a corner, square pixels or normalized: xx, xy, yy of a positive definite matrix, and not all
// but singular.
[[nodiscard]] inline bool isCovariance(double xx, double xy, double yy) {
  const auto plausible = [](double variance) { return variance >= 1e-24 && variance <= 1e12; };
  return plausible(xx) && plausible(yy) && std::abs(xy) < (1.0 - 1e-9) * std::sqrt(xx * yy);
}

}  // namespace waymark::io
