#include "slam/natural/unscaled_way.h"

#include "slam/option_checks.h"

namespace waymark::slam {

std::string UnscaledWayOptions::invalidReason() const {
  return firstUnmet({{isPositive(from_scale_sigma), "from_scale_sigma must be positive"},
                     {ratio >= 1.0, "the ratio of an unscaled way's doubt must be at least 1"}});
}

void UnscaledWay::forget() {
  p_w_.reset();
  sigma_w_.setZero();
}

void UnscaledWay::goOn(const Eigen::Vector3d& p_w, double scale_sigma) {
  if (p_w_ && scale_sigma > options_.from_scale_sigma) sigma_w_ += scale_sigma * (p_w - *p_w_);
  p_w_ = p_w;
}

Eigen::Matrix3d UnscaledWay::covariance() const {
  return (options_.ratio * options_.ratio - 1.0) * sigma_w_ * sigma_w_.transpose();
}

void UnscaledWay::moveWorld(const Transform& T_new_old) {
  if (p_w_) p_w_ = T_new_old * *p_w_;
  sigma_w_ = T_new_old.R * sigma_w_;
}

}  // namespace waymark::slam
