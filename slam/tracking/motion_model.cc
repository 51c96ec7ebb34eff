#include "slam/tracking/motion_model.h"

namespace waymark::slam {

void MotionModel::update(const Transform& T_w_c, std::int64_t time_ns) {
  velocity_ = twistTo(T_w_c, time_ns).value_or(Vector6d::Zero());
  last_ = Stamped{T_w_c, time_ns};
}

std::optional<Vector6d> MotionModel::twistTo(const Transform& T_w_c, std::int64_t time_ns) const {
  if (!last_) return std::nullopt;
  const double dt = 1e-9 * static_cast<double>(time_ns - last_->time_ns);
  if (dt <= 0.0 || dt > options_.max_extrapolation_s) return std::nullopt;
  const Transform step = last_->T_w_c.inverse() * T_w_c;
  Vector6d twist;
  twist << step.p / dt, logSo3(step.R) / dt;
  return twist;
}

void MotionModel::correct(const Transform& T_w_c) {
  if (last_) last_->T_w_c = T_w_c;
}

std::optional<Transform> MotionModel::predict(std::int64_t time_ns) const {
  if (!last_) return std::nullopt;
  const double dt = 1e-9 * static_cast<double>(time_ns - last_->time_ns);
  if (dt < 0.0 || dt > options_.max_age_s) return std::nullopt;
  if (dt > options_.max_extrapolation_s) return last_->T_w_c;
  const Transform step{expSo3(velocity_.tail<3>() * dt), velocity_.head<3>() * dt};
  return last_->T_w_c * step;
}

}  // namespace waymark::slam
