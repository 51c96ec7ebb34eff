// Covariances of poses in other axes.
#pragma once

#include "slam/geometry/transform.h"

namespace waymark::slam {

// Of (dp, dtheta), in the axes of frame b; R_a_b turns them into those of a. The same of an
// information matrix.
[[nodiscard]] inline Matrix6d turnedCovariance(const Eigen::Matrix3d& R_a_b,
                                               const Matrix6d& covariance) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = R_a_b;
  return turn * covariance * turn.transpose();
}

}  // namespace waymark::slam
