#include "slam/geometry/minimize_pose.h"

#include <Eigen/Cholesky>

namespace waymark::slam {

Vector6d dampedStep(const PoseNormal& normal, double lambda) {
  Matrix6d damped = normal.H;
  damped.diagonal() *= 1.0 + lambda;
  return -damped.ldlt().solve(normal.g);
}

std::optional<Matrix6d> inverseOf(const Matrix6d& H) {
  const Eigen::LDLT<Matrix6d> factor(H);
  if (factor.info() != Eigen::Success || !factor.isPositive()) return std::nullopt;
  return factor.solve(Matrix6d::Identity());
}

}  // namespace waymark::slam
