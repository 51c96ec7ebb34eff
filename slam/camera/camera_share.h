// What is not known of the camera, lens or shutter, in its pose. A map that was made with the same
// camera shares some of the error, so that it is rather too much than too little.
#pragma once

#include <span>

#include "slam/camera/lens_knowledge.h"
#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/geometry/twist.h"

namespace waymark::slam {

// Both: covariance of (dp, dtheta) of the solution in the world frame, metres and radians. First
// order; the camera's parameters as ones that the pose's own residuals say nothing of. markers:
// one for each of solution.inlier. Zero where the normal equations are singular.

// Where the pose would move to, the markers held, if the lens were another one of those that the
// covariance allows.
[[nodiscard]] Matrix6d lensShare(const PoseSolution& solution, std::span<const KnownMarker> markers,
                                 const CameraModel& camera, const IntrinsicMatrix& covariance);

// The same if the readout time of the rolling shutter were longer or shorter by sigma_s. twist: of
// the camera in this frame.
[[nodiscard]] Matrix6d readoutShare(const PoseSolution& solution,
                                    std::span<const KnownMarker> markers, const CameraModel& camera,
                                    const Twist& twist, double sigma_s);

}  // namespace waymark::slam
