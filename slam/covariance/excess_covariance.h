// What one covariance has beyond another of the same quantity.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "slam/geometry/transform.h"

namespace waymark::slam {

// In no direction less than nothing: their difference where that is a covariance, and of it the
// part that is one elsewhere. Zero where `other` has no inverse.
[[nodiscard]] inline Matrix6d excessOf(const Matrix6d& covariance, const Matrix6d& other) {
  const Eigen::LLT<Matrix6d> llt(other);
  if (llt.info() != Eigen::Success) return Matrix6d::Zero();
  const Matrix6d L = llt.matrixL();
  Matrix6d relative = llt.matrixL().solve(covariance);
  relative = llt.matrixL().solve(relative.transpose().eval());
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(relative);
  const Matrix6d axes = L * eigen.eigenvectors();
  const Vector6d beyond = (eigen.eigenvalues().array() - 1.0).cwiseMax(0.0);
  return axes * beyond.asDiagonal() * axes.transpose();
}

}  // namespace waymark::slam
