// How the camera moved while a rolling shutter read one frame: an unknown of the frame, as its pose
// is. The poses before tell it half an interval's acceleration late; how the rows lie to each other
// tells the rest. Beyond seed 1.
#pragma once

#include <optional>
#include <span>

#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/twist.h"

namespace waymark::slam {

// How the corners came to where they are: moved to the middle row's time with this motion.
struct Deskewing {
  const CameraModel& camera;
  double readout_s;
  Twist twist;
};
struct ExpectedMotion {
  Twist twist;
  Matrix6d covariance;  // (m/s)^2, (rad/s)^2, in the camera frame; positive definite
};
struct ReadoutMotion {
  Twist twist;
  // What is still not known of it adds this to the covariance of the pose, (dp, dtheta) in the
  // world frame.
  Matrix6d of_pose;
};

// The motion that goes best with the corners and with what is expected, the pose free. One step of
// Gauss-Newton from `solution`, which is of these corners; they have to be moved with it, and the
// pose found again. markers: one for each of solution.inlier. Empty where the corners do not tell a
// pose.
[[nodiscard]] std::optional<ReadoutMotion> estimateReadoutMotion(
    const PoseSolution& solution, std::span<const KnownMarker> markers, const Deskewing& deskewing,
    const ExpectedMotion& expected);

}  // namespace waymark::slam
