// Where the camera is expected to be in a frame, before anything of the frame is looked at. Made
// once, at the top of the frame, and handed down: any source of motion can supply it.
#pragma once

#include "slam/geometry/transform.h"

namespace waymark::slam {

struct Prediction {
  Transform T_w_c;
  // Of (dp, dtheta) as in Transform::retract: metres and radians, in the world frame.
  Matrix6d covariance = Matrix6d::Zero();
  // Of the camera in its own frame, metres and radians per second; zero where nothing is known.
  Vector6d twist = Vector6d::Zero();
  // The camera of the last frame that had a pose.
  Transform T_w_last;
};

}  // namespace waymark::slam
