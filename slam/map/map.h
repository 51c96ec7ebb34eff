// The map W of seed 1, section 3.3: markers, keyframes and who sees what.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

// gamma_m of the paper. Empty pose: seen, but not yet estimated (the paper's gamma_m = 0).
struct MapMarker {
  int id = -1;
  double size_m = 0.0;
  std::optional<Transform> T_w_m;

  // Corners in the world, metres. Precondition: T_w_m has a value.
  [[nodiscard]] std::array<Eigen::Vector3d, 4> cornersInWorld() const;
};

// A frame kept for optimisation, with the markers it sees (Lambda^i, Eq. 13).
struct Keyframe {
  std::int64_t index = -1;  // unique and ever growing within a map
  std::uint64_t sequence = 0;
  std::int64_t monotonic_ns = 0;
  Transform T_w_c;                          // inverse of the paper's gamma^i
  std::vector<MarkerDetection> detections;  // sorted by id

  // Null when the keyframe does not see the marker.
  [[nodiscard]] const MarkerDetection* find(int id) const;
};

struct Map {
  std::string dictionary;
  std::map<int, MapMarker> markers;  // by id
  std::vector<Keyframe> keyframes;   // in the order of insertion; the first one fixes the gauge
  std::int64_t next_keyframe_index = 0;

  [[nodiscard]] bool empty() const { return keyframes.empty(); }
  // Null when the marker is unknown.
  [[nodiscard]] const MapMarker* find(int id) const;
  // Null when the marker is unknown or has no pose yet.
  [[nodiscard]] const MapMarker* findPosed(int id) const;
};

}  // namespace waymark::slam
