#include "slam/tracking/motion_model.h"

#include "base/elapsed.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Of (dp, dtheta), from the standard deviations of a coordinate of each.
Matrix6d isotropic(double sigma_m, double sigma_rad) {
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(sigma_m * sigma_m);
  covariance.diagonal().tail<3>().setConstant(sigma_rad * sigma_rad);
  return covariance;
}

}  // namespace

std::string MotionModelOptions::invalidReason() const {
  return firstUnmet({
      {isNotNegative(max_extrapolation_s) && isNotNegative(max_age_s),
       "the gaps that a motion outlasts must not be negative"},
      {isNotNegative(acceleration_sigma) && isNotNegative(angular_acceleration_sigma),
       "the sigmas of accelerations must not be negative"},
      {isNotNegative(velocity_sigma) && isNotNegative(angular_velocity_sigma),
       "the sigmas of velocities must not be negative"},
      {acceleration_frames >= 1, "an acceleration needs at least 1 frame to be learned from"},
  });
}

MotionModel::MotionModel(const MotionModelOptions& options)
    : options_(options),
      acceleration_square_(
          isotropic(options.acceleration_sigma, options.angular_acceleration_sigma)) {}

void MotionModel::update(const Transform& T_w_c, const Matrix6d& covariance, std::int64_t time_ns) {
  const auto twist = twistTo(T_w_c, time_ns);
  if (twist) learnAcceleration(*twist, secondsBetween(last_->time_ns, time_ns));
  velocity_ = twist.value_or(Vector6d::Zero());
  velocity_interval_s_ = twist ? secondsBetween(last_->time_ns, time_ns) : 0.0;
  velocity_covariance_ = Matrix6d::Zero();
  if (twist) {
    velocity_covariance_ =
        (covariance + last_->covariance) / (velocity_interval_s_ * velocity_interval_s_);
  }
  last_ = Stamped{T_w_c, covariance, time_ns};
}

std::optional<Vector6d> MotionModel::twistTo(const Transform& T_w_c, std::int64_t time_ns) const {
  const auto dt = recentInterval(time_ns);
  if (!dt) return std::nullopt;
  const Transform step = last_->T_w_c.inverse() * T_w_c;
  Vector6d twist;
  twist << step.p / *dt, logSo3(step.R) / *dt;
  return twist;
}

Matrix6d MotionModel::twistCovariance(std::int64_t time_ns) const {
  const auto dt = recentInterval(time_ns);
  if (!dt) return isotropic(options_.velocity_sigma, options_.angular_velocity_sigma);
  return 0.25 * *dt * *dt * acceleration_square_;
}

std::optional<double> MotionModel::recentInterval(std::int64_t time_ns) const {
  if (!last_) return std::nullopt;
  const double dt = secondsBetween(last_->time_ns, time_ns);
  if (dt <= 0.0 || dt > options_.max_extrapolation_s) return std::nullopt;
  return dt;
}

// The poses' errors look like acceleration. They are as much of an error of twistTo() as that.
void MotionModel::learnAcceleration(const Vector6d& twist, double interval_s) {
  if (velocity_interval_s_ <= 0.0) return;
  const Vector6d acceleration = (twist - velocity_) / (0.5 * (interval_s + velocity_interval_s_));
  const double share = 1.0 / options_.acceleration_frames;
  acceleration_square_ += share * (acceleration * acceleration.transpose() - acceleration_square_);
}

void MotionModel::correct(const Transform& T_w_c) {
  if (last_) last_->T_w_c = T_w_c;
}

std::optional<Prediction> MotionModel::predict(std::int64_t time_ns) const {
  if (!last_) return std::nullopt;
  const double dt = secondsBetween(last_->time_ns, time_ns);
  if (dt < 0.0 || dt > options_.max_age_s) return std::nullopt;
  Prediction prediction;
  prediction.T_w_last = prediction.T_w_c = last_->T_w_c;
  const bool extrapolates = dt <= options_.max_extrapolation_s;
  if (extrapolates) {
    const Transform step{expSo3(velocity_.tail<3>() * dt), velocity_.head<3>() * dt};
    prediction.T_w_c = last_->T_w_c * step;
  }
  prediction.twist = twistTo(prediction.T_w_c, time_ns).value_or(Vector6d::Zero());
  if (extrapolates && velocity_interval_s_ > 0.0) {
    // The last pose's error moves the prediction and turns the velocity the same way: with gain
    // 1 + dt / interval, that of the pose before with dt / interval.
    const double gain = dt / velocity_interval_s_;
    const double lever_s2 = 0.5 * dt * (dt + velocity_interval_s_);
    prediction.covariance = (1.0 + 2.0 * gain) * last_->covariance +
                            dt * dt * velocity_covariance_ +
                            isotropic(options_.acceleration_sigma * lever_s2,
                                      options_.angular_acceleration_sigma * lever_s2);
  } else {
    prediction.covariance = last_->covariance + isotropic(options_.velocity_sigma * dt,
                                                          options_.angular_velocity_sigma * dt);
  }
  return prediction;
}

}  // namespace waymark::slam
