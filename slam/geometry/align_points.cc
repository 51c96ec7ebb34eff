#include "slam/geometry/align_points.h"

#include <Eigen/Geometry>

namespace waymark::slam {

Transform alignPoints(std::span<const Eigen::Vector3d> from, std::span<const Eigen::Vector3d> to) {
  Eigen::Matrix3Xd source(3, static_cast<Eigen::Index>(from.size()));
  Eigen::Matrix3Xd target(3, static_cast<Eigen::Index>(to.size()));
  for (Eigen::Index i = 0; i < source.cols(); ++i) {
    source.col(i) = from[static_cast<std::size_t>(i)];
    target.col(i) = to[static_cast<std::size_t>(i)];
  }
  const Eigen::Matrix4d T = Eigen::umeyama(source, target, /*with_scaling=*/false);
  return {T.topLeftCorner<3, 3>(), T.topRightCorner<3, 1>()};
}

}  // namespace waymark::slam
