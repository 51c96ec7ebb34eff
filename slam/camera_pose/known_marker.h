// A detected marker whose pose the map knows: what tracking and relocalization work with.
#pragma once

#include <array>
#include <optional>
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
// The same into a vector that is used again and again.
void findKnownMarkers(const Map& map, std::span<const MarkerDetection> detections,
                      std::vector<KnownMarker>* known);

// How far those of them that have a pose in the map are from a camera, metres; empty without any.
[[nodiscard]] std::optional<double> medianDepth(const Map& map,
                                                std::span<const MarkerDetection> detections,
                                                const Transform& T_w_c);

}  // namespace waymark::slam
