#pragma once

#include "slam/geometry/transform.h"

namespace waymark::slam {

// Velocity of the camera in its own frame: metres per second, then radians per second.
using Twist = Vector6d;

}  // namespace waymark::slam
