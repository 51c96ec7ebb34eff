// How a frame's pose moves with what is not known of the camera, lens or shutter.
#pragma once

#include <cstdint>
#include <span>

#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/covariance/camera_uncertainty.h"
#include "slam/geometry/twist.h"

namespace waymark::slam {

// d (dp, dtheta) / d parameters of the solution, in the world frame, the markers held where they
// are: metres and radians. First order. A map that was made with the same camera moves, too
// (MapMarginals::byCamera). markers: one for each of solution.inlier. twist: of the camera in this
// frame. Zero where the normal equations are singular.
[[nodiscard]] PoseGlobalMatrix poseByCamera(const PoseSolution& solution,
                                            std::span<const KnownMarker> markers,
                                            const CameraUncertainty& camera, const Twist& twist,
                                            std::int64_t time_ns);

// Of a pose that moves like this with the parameters. What is not linear of it is a share of that,
// as large as the focal length's own doubt is, in any direction: of a lens whose focal length is
// known to a third, no pose is known exactly across the one way that a first order sees.
[[nodiscard]] Matrix6d covarianceByCamera(const CameraUncertainty& camera,
                                          const PoseGlobalMatrix& by_camera);

}  // namespace waymark::slam
