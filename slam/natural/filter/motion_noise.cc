#include "slam/natural/filter/motion_noise.h"

#include "slam/option_checks.h"

namespace waymark::slam {

std::string MotionNoiseOptions::invalidReason() const {
  return firstUnmet({
      {isPositive(acceleration), "acceleration must be positive"},
      {isPositive(angular_acceleration), "angular_acceleration must be positive"},
      {isPositive(start_velocity_sigma), "start_velocity_sigma must be positive"},
      {isPositive(start_angular_velocity_sigma), "start_angular_velocity_sigma must be positive"},
  });
}

}  // namespace waymark::slam
