#include "daemon/publish/body_motion.h"

#include <Eigen/Cholesky>

namespace waymark::daemon {
namespace {

using slam::Matrix6d;
using slam::Transform;
using slam::Vector6d;

// Nothing is known of a velocity at first but that robots are slower than this.
constexpr double kMaxSpeed_m_s = 10.0;
constexpr double kMaxTurnRate_rad_s = 20.0;
// No pose is better than this, whatever its covariance says: 10 micrometres, 10 microradians.
constexpr double kFinest = 1e-5;

// The camera's covariance moved to the body's origin: p_b = p_c + R_w_c * p_c_b. That relative to
// the markers in view: what the map has wrong is the same in the next frame, and no motion.
Matrix6d covarianceOfBody(const slam::PoseEstimate& pose, const Transform& T_c_b) {
  Matrix6d J = Matrix6d::Identity();
  J.topRightCorner<3, 3>() = -slam::skew(pose.T_w_c.R * T_c_b.p);
  return J * pose.view_covariance * J.transpose() + kFinest * kFinest * Matrix6d::Identity();
}

}  // namespace

BodyState BodyMotion::update(const slam::PoseEstimate& pose, std::int64_t monotonic_ns) {
  const Transform T_c_b = options_.T_b_c.inverse();
  const Transform T_w_b = pose.T_w_c * T_c_b;
  const Matrix6d covariance = covarianceOfBody(pose, T_c_b);
  const double dt_s = last_ns_ ? 1e-9 * static_cast<double>(monotonic_ns - *last_ns_) : -1.0;
  const bool elsewhere = pose.piece != piece_;
  piece_ = pose.piece;
  if (dt_s <= 0.0 || dt_s > options_.max_gap_s || elsewhere) {
    begin(T_w_b, covariance);
  } else {
    predict(dt_s);
    const bool jumped_before = jumped_;
    jumped_ = !correct(T_w_b, covariance);
    if (jumped_) T_w_b_ = T_w_b;  // with the velocity that it had
    if (jumped_ && jumped_before) begin(T_w_b, covariance);
  }
  last_ns_ = monotonic_ns;
  return {T_w_b, T_w_b.R.transpose() * twist_w_.head<3>(),
          T_w_b.R.transpose() * twist_w_.tail<3>()};
}

void BodyMotion::enterWorld(int piece, const slam::PieceEvent& event) {
  const bool forth = piece_ == event.piece && piece == event.into;
  const bool back = piece_ == event.into && piece == event.piece;
  if (!forth && !back) return;
  piece_ = piece;
  const Transform T_v_w = forth ? event.T_into_piece : event.T_into_piece.inverse();
  T_w_b_ = T_v_w * T_w_b_;
  Matrix12d turn = Matrix12d::Zero();
  for (int i = 0; i < 12; i += 3) turn.block<3, 3>(i, i) = T_v_w.R;
  twist_w_ = turn.topLeftCorner<6, 6>() * twist_w_;
  covariance_ = turn * covariance_ * turn.transpose();
}

void BodyMotion::begin(const Transform& T_w_b, const Matrix6d& covariance) {
  T_w_b_ = T_w_b;
  jumped_ = false;
  twist_w_.setZero();
  covariance_.setZero();
  covariance_.topLeftCorner<6, 6>() = covariance;
  covariance_.diagonal().segment<3>(6).setConstant(kMaxSpeed_m_s * kMaxSpeed_m_s);
  covariance_.diagonal().tail<3>().setConstant(kMaxTurnRate_rad_s * kMaxTurnRate_rad_s);
}

void BodyMotion::predict(double dt_s) {
  T_w_b_ = T_w_b_.retract(dt_s * twist_w_);
  Matrix12d F = Matrix12d::Identity();
  F.topRightCorner<6, 6>() = dt_s * Matrix6d::Identity();
  Vector6d density;
  density.head<3>().setConstant(options_.acceleration);
  density.tail<3>().setConstant(options_.angular_acceleration);
  Matrix12d Q = Matrix12d::Zero();
  Q.topLeftCorner<6, 6>().diagonal() = dt_s * dt_s * dt_s / 3.0 * density;
  Q.topRightCorner<6, 6>().diagonal() = dt_s * dt_s / 2.0 * density;
  Q.bottomLeftCorner<6, 6>() = Q.topRightCorner<6, 6>();
  Q.bottomRightCorner<6, 6>().diagonal() = dt_s * density;
  covariance_ = F * covariance_ * F.transpose() + Q;
}

bool BodyMotion::correct(const Transform& T_w_b, const Matrix6d& covariance) {
  const Vector6d innovation = T_w_b_.localCoordinates(T_w_b);
  const Matrix6d S = covariance_.topLeftCorner<6, 6>() + covariance;
  const Eigen::LLT<Matrix6d> factor(S);
  if (innovation.dot(factor.solve(innovation)) > options_.jump_chi2) return false;
  const Eigen::Matrix<double, 12, 6> gain = factor.solve(covariance_.topRows<6>()).transpose();
  const Vector12d correction = gain * innovation;
  T_w_b_ = T_w_b_.retract(correction.head<6>());
  twist_w_ += correction.tail<6>();
  covariance_ -= gain * covariance_.topRows<6>().eval();
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();
  return true;
}

}  // namespace waymark::daemon
