// How little is known of the way the camera moves: velocity and angular velocity are constant but
// for white accelerations (seed 2, section 3.2).
#pragma once

#include <string>

namespace waymark::slam {

struct MotionNoiseOptions {
  // Square roots of the accelerations' spectral densities, m/s^2/sqrt(Hz) and rad/s^2/sqrt(Hz):
  // the velocity's standard deviation has grown to this after a second. The defaults are a
  // hand-held camera's; a robot on wheels does with half of them. Larger: wider searches, and more
  // doubt where features are few. Smaller: features are missed in jerks.
  double acceleration = 0.8;
  double angular_acceleration = 2.0;
  // Of a camera whose motion is not known yet, m/s and rad/s.
  double start_velocity_sigma = 1.0;
  double start_angular_velocity_sigma = 1.5;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

}  // namespace waymark::slam
