#include "slam/geometry/homography.h"

#include <cmath>

namespace waymark::slam {

std::optional<Eigen::Matrix3d> homographyFromUnitSquare(
    const std::array<Eigen::Vector2d, 4>& quad) {
  const Eigen::Vector2d d1 = quad[1] - quad[2];
  const Eigen::Vector2d d2 = quad[3] - quad[2];
  const Eigen::Vector2d s = quad[0] - quad[1] + quad[2] - quad[3];
  const double determinant = d1.x() * d2.y() - d2.x() * d1.y();
  const double scale = d1.squaredNorm() + d2.squaredNorm();
  if (!(std::abs(determinant) > 1e-9 * scale)) return std::nullopt;
  const double g = (s.x() * d2.y() - d2.x() * s.y()) / determinant;
  const double h = (d1.x() * s.y() - s.x() * d1.y()) / determinant;
  Eigen::Matrix3d H;
  H.col(0) << quad[1] - quad[0] + g * quad[1], g;
  H.col(1) << quad[3] - quad[0] + h * quad[3], h;
  H.col(2) << quad[0], 1.0;
  return H;
}

}  // namespace waymark::slam
