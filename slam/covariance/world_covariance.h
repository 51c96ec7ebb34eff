// A camera pose's covariance in the world: what the corners' noise makes of it, and what the map
// does not know of the markers that it was found from.
#pragma once

#include <optional>
#include <span>

#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/covariance/marginals.h"

namespace waymark::slam {

// How far the map around a point is from where it should be, as a rigid body.
struct PlaceDoubt {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();  // metres
  Matrix6d covariance = Matrix6d::Zero();         // of (dp, dtheta) there: metres, radians
};

struct WorldCovariance {
  Matrix6d covariance = Matrix6d::Zero();  // of (dp, dtheta) of T_w_c: metres, radians, world frame
  // The map's share, at the camera. Empty where the marginals know none of the markers.
  std::optional<PlaceDoubt> doubt;
};

// The pose is a weighted mean of what each marker says: their errors go into it with those weights
// (first order). A marker that the marginals do not know (it is new), or whose common covariance
// with those that say more was not computed, hangs on the one that says most, as a rigid body, with
// its own doubt; where none is known, all hang on `otherwise`. markers: one for each of
// solution.inlier. Empty when the pose's normal equations are singular.
[[nodiscard]] std::optional<WorldCovariance> worldCovariance(const PoseSolution& solution,
                                                             std::span<const KnownMarker> markers,
                                                             const MapMarginals& marginals,
                                                             const PlaceDoubt& otherwise);

}  // namespace waymark::slam
