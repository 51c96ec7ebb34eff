#include "slam/covariance/marginals.h"

namespace waymark::slam {

Matrix6d rigidTransport(const Eigen::Vector3d& to_from_m) {
  Matrix6d T = Matrix6d::Identity();
  T.topRightCorner<3, 3>() = -skew(to_from_m);
  return T;
}

const Matrix6d* MapMarginals::find(int marker) const {
  const auto found = own_.find(marker);
  return found == own_.end() ? nullptr : &found->second;
}

std::optional<Matrix6d> MapMarginals::between(int a, int b) const {
  if (a == b) return own_.at(a);
  const auto found = between_.find(std::minmax(a, b));
  if (found == between_.end()) return std::nullopt;
  if (a < b) return found->second;
  return found->second.transpose();
}

}  // namespace waymark::slam
