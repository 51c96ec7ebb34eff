// Constant-velocity prediction of the camera pose, the start of tracking (seed 1, section 4.3,
// which starts from the previous pose itself).
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "slam/geometry/transform.h"
#include "slam/tracking/prediction.h"

namespace waymark::slam {

struct MotionModelOptions {
  // Beyond this gap since the last pose the velocity says nothing any more, seconds.
  double max_extrapolation_s = 0.2;
  // Beyond this gap the last pose itself is no prior any more, seconds.
  double max_age_s = 1.0;
  // What the velocity does not know, for the prediction's covariance: standard deviations of a
  // hand-held camera's accelerations, m/s^2 and rad/s^2 ...
  double acceleration_sigma = 5.0;
  double angular_acceleration_sigma = 20.0;
  // ... and of its velocities, where the last pose alone is what is known, m/s and rad/s.
  double velocity_sigma = 1.0;
  double angular_velocity_sigma = 2.0;
  // How strongly the camera accelerates is learned from so many of the last frames. More is
  // steadier, fewer follow a robot that begins to hurry.
  int acceleration_frames = 20;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

class MotionModel {
 public:
  explicit MotionModel(const MotionModelOptions& options = {});

  // covariance: of (dp, dtheta), as PoseEstimate's.
  void update(const Transform& T_w_c, const Matrix6d& covariance, std::int64_t time_ns);
  // The map moved under the camera: same instant, new coordinates. The velocity is kept.
  void correct(const Transform& T_w_c);

  // The camera's velocity in its own frame, m/s and rad/s, if it is at T_w_c now; empty without a
  // recent pose.
  [[nodiscard]] std::optional<Vector6d> twistTo(const Transform& T_w_c, std::int64_t time_ns) const;

  // How far the camera's velocity at that time is from what twistTo() says, a covariance in the
  // camera frame, (m/s)^2 and (rad/s)^2: a mean since the last pose is half an interval's
  // acceleration late. Without a recent pose, of the velocity itself.
  [[nodiscard]] Matrix6d twistCovariance(std::int64_t time_ns) const;

  // As last given; empty before the first.
  [[nodiscard]] std::optional<Transform> lastPose() const {
    return last_ ? std::optional(last_->T_w_c) : std::nullopt;
  }
  // Empty without a recent pose. Its covariance takes the errors of the last two poses as
  // independent: too large rather than too small where they share the map's.
  [[nodiscard]] std::optional<Prediction> predict(std::int64_t time_ns) const;

 private:
  struct Stamped {
    Transform T_w_c;
    Matrix6d covariance;
    std::int64_t time_ns;
  };
  // Since the last pose, seconds; empty where that is too long ago to tell a velocity.
  [[nodiscard]] std::optional<double> recentInterval(std::int64_t time_ns) const;
  void learnAcceleration(const Vector6d& twist, double interval_s);

  MotionModelOptions options_;
  std::optional<Stamped> last_;
  // Motion per second in the camera frame: translation, then rotation vector.
  Vector6d velocity_ = Vector6d::Zero();
  Matrix6d velocity_covariance_ = Matrix6d::Zero();  // in the world frame, of the poses' errors
  double velocity_interval_s_ = 0.0;                 // that it was measured over; 0 for none
  Matrix6d acceleration_square_;                     // mean of the last ones', camera frame
};

}  // namespace waymark::slam
