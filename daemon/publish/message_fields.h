// How our own types stand in messages.
#pragma once

#include <algorithm>
#include <cmath>

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>

#include "slam/geometry/transform.h"

namespace waymark::daemon {

inline void put(const Eigen::Vector3d& v, double (&out)[3]) { std::copy_n(v.data(), 3, out); }

// w, x, y, z
inline void put(const Eigen::Quaterniond& q, double (&out)[4]) {
  out[0] = q.w();
  out[1] = q.x();
  out[2] = q.y();
  out[3] = q.z();
}

// Row by row.
inline void put(const slam::Matrix6d& matrix, double (&out)[36]) {
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>{out} = matrix;
}

// Of a position, along its worst axis.
inline double positionSigma(const Eigen::Matrix3d& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(covariance, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, axes.eigenvalues().maxCoeff()));
}

}  // namespace waymark::daemon
