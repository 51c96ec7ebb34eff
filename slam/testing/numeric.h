// Central differences, to hold the solvers' own derivatives against.
#pragma once

#include <Eigen/Core>

#include "slam/geometry/transform.h"

namespace waymark::slam::testing {

// d f / d delta at T, for f(Transform) that returns a vector.
template <typename F>
[[nodiscard]] Eigen::Matrix<double, Eigen::Dynamic, 6> numericJacobian(const Transform& T,
                                                                       const F& f,
                                                                       double step = 1e-6) {
  Eigen::Matrix<double, Eigen::Dynamic, 6> J(f(T).size(), 6);
  for (int i = 0; i < 6; ++i) {
    const Vector6d delta = step * Vector6d::Unit(i);
    J.col(i) = (f(T.retract(delta)) - f(T.retract(-delta))) / (2.0 * step);
  }
  return J;
}

}  // namespace waymark::slam::testing
