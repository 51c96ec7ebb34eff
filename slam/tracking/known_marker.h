// A detected marker whose pose the map knows: what tracking and relocalisation work with.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "slam/map/map.h"

namespace waymark::slam {

struct KnownMarker {
  const MarkerDetection* detection = nullptr;
  Transform T_w_m;
  double size_m = 0.0;
  // Of (dp, dtheta) of T_w_m: what the map does not know of the marker.
  Matrix6d covariance = Matrix6d::Zero();
  std::array<Eigen::Vector3d, 4> corners_w;  // metres
};

// Those of the detections that have a pose in the map. The detections must outlive the result.
[[nodiscard]] std::vector<KnownMarker> knownMarkers(const Map& map,
                                                    std::span<const MarkerDetection> detections);

}  // namespace waymark::slam
