// What is not known of the lens, in a camera's pose.
#pragma once

#include <span>

#include "slam/camera/lens_knowledge.h"
#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/pose_optimizer.h"

namespace waymark::slam {

// Of (dp, dtheta) of the solution in the world frame: where the pose would move to, the markers
// held, if the lens were another one of those that the covariance allows (first order; the lens as
// a parameter that the pose's own residuals say nothing of). A map that was made through the same
// lens shares some of the error, so that it is rather too much than too little. markers: one for
// each of solution.inlier. Zero where the normal equations are singular.
[[nodiscard]] Matrix6d lensShare(const PoseSolution& solution, std::span<const KnownMarker> markers,
                                 const CameraModel& camera, const IntrinsicMatrix& covariance);

}  // namespace waymark::slam
