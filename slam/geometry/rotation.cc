#include "slam/geometry/rotation.h"

#include <Eigen/Geometry>

namespace waymark::slam {

Eigen::Matrix3d rotationBetween(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  return Eigen::Quaterniond::FromTwoVectors(from, to).toRotationMatrix();
}

}  // namespace waymark::slam
