// A camera that goes on as it moves.
#pragma once

#include "slam/geometry/transform.h"
#include "slam/geometry/twist.h"

namespace waymark::slam {

// Where a camera at T_w_c is some seconds later: turn and way at once, for short times.
[[nodiscard]] inline Transform movedOn(const Transform& T_w_c, const Twist& twist, double seconds) {
  return T_w_c * Transform{expSo3(seconds * twist.tail<3>()), seconds * twist.head<3>()};
}

}  // namespace waymark::slam
