// What one view of a marker says of the marker's place, or of the camera's.
#pragma once

#include <optional>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

struct MarkerInformation {
  // J^T W J by (dp, dtheta) of T_w_m, W the corners' weights: the information on the marker, the
  // camera held.
  Matrix6d weighted = Matrix6d::Zero();
  // J^T W R W J, R the corners' covariances in the image: what their noise puts into J^T W r.
  Matrix6d noise = Matrix6d::Zero();
};

// doubt: covariance of (dp, dtheta) of T_w_m that lowers the corners' weights, as in PoseOptimizer;
// zero for weights of the image noise alone, and then both are the same. Empty when a corner is
// behind the camera.
[[nodiscard]] std::optional<MarkerInformation> markerInformation(const Transform& T_w_m,
                                                                 double size_m,
                                                                 const MarkerDetection& detection,
                                                                 const Transform& T_w_c,
                                                                 const Matrix6d& doubt);

}  // namespace waymark::slam
