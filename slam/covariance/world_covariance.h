// A camera pose's covariance in the world: what the corners' noise makes of it, and what the map
// does not know of the markers that it was found from.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/camera_pose/known_marker.h"
#include "slam/camera_pose/pose_optimizer.h"
#include "slam/covariance/marginals.h"

namespace waymark::slam {

// How far the map around a point is from where it should be, as a rigid body.
struct PlaceDoubt {
  Eigen::Vector3d p_w = Eigen::Vector3d::Zero();  // metres
  Matrix6d covariance = Matrix6d::Zero();         // of (dp, dtheta) there: metres, radians
  // How it moves with the camera's parameters; what is not known of these is not in `covariance`.
  PoseGlobalMatrix by_camera = PoseGlobalMatrix::Zero();

  // The same of another point of that body.
  [[nodiscard]] PlaceDoubt at(const Eigen::Vector3d& point_w) const;
};

// The camera is taken as it is.
struct WorldCovariance {
  Matrix6d covariance = Matrix6d::Zero();  // of (dp, dtheta) of T_w_c: metres, radians, world frame
  // What it is made of: of the corners, where the residuals' variance is 1; of markers that the
  // marginals do not know, given the others; and the map's share, the rest.
  Matrix6d of_corners = Matrix6d::Zero();
  Matrix6d of_new_markers = Matrix6d::Zero();
  Matrix6d of_map = Matrix6d::Zero();
  // The map's share, at the camera. Empty where the marginals know none of the markers.
  std::optional<PlaceDoubt> doubt;
};

// The pose is a weighted mean of what each marker says: their errors go into it with those weights
// (first order). A marker that the marginals do not know (it is new), or whose common covariance
// with those that say more was not computed, hangs on the one that says most, as a rigid body, with
// its own doubt; where none is known, all hang on `otherwise`. What that has beyond the doubt of
// the known one stays with those that hang on it: it may have just come from elsewhere in the map,
// where more is known, and not be brought together with them yet; but no more of it than if all
// hung on `otherwise`. markers: one for each of
// solution.inlier. Empty when the pose's normal equations are singular.
[[nodiscard]] std::optional<WorldCovariance> worldCovariance(const PoseSolution& solution,
                                                             std::span<const KnownMarker> markers,
                                                             const MapMarginals& marginals,
                                                             const PlaceDoubt& otherwise);

// That, kept for the next frames: while the same markers are seen as sharply from nearly the same
// place, it is nearly the same, and to compute it costs half as much as to track the frame.
//
// What was computed holds while the camera has moved by less than this share of the distance to the
// nearest marker, and turned by less than this: standard deviations change by as much, hundredths.
inline constexpr double kSameDistance = 0.02;
inline constexpr double kSameView_rad = 0.03;
// And while the corners' variances, and those of the markers given the map, are in sum within this
// share of what they were: half of it in standard deviations.
inline constexpr double kSameVariance = 0.1;

class KeptPoseCovariance {
 public:
  // Of this pose, where what was kept holds for it: the map's share carried along as a rigid body,
  // the corners' with the variance of these residuals. markers: one for each of solution.inlier.
  [[nodiscard]] std::optional<WorldCovariance> find(const PoseSolution& solution,
                                                    std::span<const KnownMarker> markers) const;
  void keep(const WorldCovariance& covariance, const PoseSolution& solution,
            std::span<const KnownMarker> markers);
  // The map knows something else by now.
  void forget() { kept_.reset(); }

 private:
  // Of the markers that the pose is from.
  struct View {
    double nearest_m = 0.0;
    double corners = 0.0;       // sum of variances, normalized coordinates
    double places_m2 = 0.0;     // the same of the markers' places given the map, metres ...
    double attitudes_r2 = 0.0;  // ... and radians, squared
  };
  [[nodiscard]] static View viewOf(const PoseSolution& solution,
                                   std::span<const KnownMarker> markers);
  [[nodiscard]] bool areTheSame(const PoseSolution& solution,
                                std::span<const KnownMarker> markers) const;

  std::optional<WorldCovariance> kept_;
  Transform T_w_c_;
  View view_;
  std::vector<int> ids_;  // of the markers, in their order
};

}  // namespace waymark::slam
