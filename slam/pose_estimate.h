// What a frame's pose is and how well it is known.
#pragma once

#include "slam/geometry/transform.h"

namespace waymark::slam {

enum class PoseSource { kNone, kMarkers, kNaturalFeatures, kPrediction };

struct PoseEstimate {
  Transform T_w_c;
  int piece = 0;  // of the map: the world that the pose is in (Map::piece)
  // Of (dp, dtheta) as in Transform::retract: metres and radians, both in the world frame; with
  // what the map does not know of its markers.
  Matrix6d covariance = Matrix6d::Zero();
  // The same relative to the markers that the pose was found from, as if each were where the map
  // has it but for what its own views leave open: for whoever works close to them.
  Matrix6d view_covariance = Matrix6d::Zero();
  // Velocity of the camera in its own frame, metres and radians per second; zero in the first frame
  // after a gap.
  Vector6d twist = Vector6d::Zero();
  PoseSource source = PoseSource::kNone;
  int markers_used = 0;
  int features_used = 0;  // natural ones, where the pose is from them
  double reprojection_rms_px = 0.0;
  // Squared-error ratio of the best and the second pose hypothesis: large is unambiguous, 1 is a
  // coin toss.
  double ambiguity_ratio = 0.0;
};

}  // namespace waymark::slam
