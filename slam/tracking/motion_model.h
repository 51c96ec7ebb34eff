// Constant-velocity prediction of the camera pose, the start of tracking (seed 1, section 4.3,
// which starts from the previous pose itself).
#pragma once

#include <cstdint>
#include <optional>

#include "slam/geometry/transform.h"

namespace waymark::slam {

struct MotionModelOptions {
  // Beyond this gap since the last pose the velocity says nothing any more, seconds.
  double max_extrapolation_s = 0.2;
  // Beyond this gap the last pose itself is no prior any more, seconds.
  double max_age_s = 1.0;
};

class MotionModel {
 public:
  explicit MotionModel(const MotionModelOptions& options = {}) : options_(options) {}

  void update(const Transform& T_w_c, std::int64_t time_ns);
  // The map moved under the camera: same instant, new coordinates. The velocity is kept.
  void correct(const Transform& T_w_c);

  // The camera's velocity in its own frame, m/s and rad/s, if it is at T_w_c now; empty without a
  // recent pose.
  [[nodiscard]] std::optional<Vector6d> twistTo(const Transform& T_w_c, std::int64_t time_ns) const;

  // As last given; empty before the first.
  [[nodiscard]] std::optional<Transform> lastPose() const {
    return last_ ? std::optional(last_->T_w_c) : std::nullopt;
  }
  // Empty without a recent pose.
  [[nodiscard]] std::optional<Transform> predict(std::int64_t time_ns) const;

 private:
  struct Stamped {
    Transform T_w_c;
    std::int64_t time_ns;
  };
  MotionModelOptions options_;
  std::optional<Stamped> last_;
  // Motion per second in the camera frame: translation, then rotation vector.
  Vector6d velocity_ = Vector6d::Zero();
};

}  // namespace waymark::slam
