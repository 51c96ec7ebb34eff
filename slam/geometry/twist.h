#pragma once

#include "slam/geometry/transform.h"

namespace waymark::slam {

// Velocity of the camera in its own frame: metres per second, then radians per second.
using Twist = Vector6d;

// The motion in the middle of two intervals of this length, from the mean of each, `before` and
// `after`; that of the first is in the axes of its beginning, as a pose's own difference to the one
// before it is. What one of them alone is off by, half an interval's acceleration, is gone. Zero is
// a motion that is not known: then the other one's; and that of long after says nothing.
[[nodiscard]] inline Twist twistBetween(const Twist& before, const Twist& after,
                                        double interval_s) {
  constexpr double kLater_s = 0.2;
  if (after.isZero(0.0) || interval_s > kLater_s) return before;
  if (before.isZero(0.0)) return after;
  Twist turned = before;
  turned.head<3>() = expSo3(-interval_s * before.tail<3>()) * before.head<3>();
  return 0.5 * (turned + after);
}

}  // namespace waymark::slam
