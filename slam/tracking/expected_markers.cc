#include "slam/tracking/expected_markers.h"

#include <array>
#include <cstddef>

#include "slam/geometry/reprojection.h"

namespace waymark::slam {
namespace {

// Normalized. False when a corner is not in front of the camera.
bool project(const std::array<Eigen::Vector3d, 4>& corners_w, const Transform& T_w_c,
             std::array<Eigen::Vector2d, 4>* corners) {
  for (std::size_t k = 0; k < 4; ++k) {
    Projection projection;
    if (!projectPoint(T_w_c, corners_w[k], &projection)) return false;
    (*corners)[k] = projection.normalized;
  }
  return true;
}

}  // namespace

void expectMarkers(const Map& map, std::span<const int> ids, const Transform& T_w_c_before,
                   const Transform& T_w_c_now, std::vector<ExpectedMarker>* expected) {
  expected->clear();
  for (const int id : ids) {
    const MapMarker* const marker = map.findPosed(id);
    if (marker == nullptr) continue;
    const auto corners_w = marker->cornersInWorld();
    ExpectedMarker place;
    place.id = id;
    if (project(corners_w, T_w_c_before, &place.before) &&
        project(corners_w, T_w_c_now, &place.now)) {
      expected->push_back(place);
    }
  }
}

}  // namespace waymark::slam
