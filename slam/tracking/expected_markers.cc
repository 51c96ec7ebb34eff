#include "slam/tracking/expected_markers.h"

#include <cstddef>

namespace waymark::slam {
namespace {

// Normalised. False when a corner is not in front of the camera.
bool project(const std::array<Eigen::Vector3d, 4>& corners_w, const Transform& T_c_w,
             std::array<Eigen::Vector2d, 4>* corners) {
  constexpr double kNearest_m = 1e-3;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d p_c = T_c_w * corners_w[k];
    if (p_c.z() < kNearest_m) return false;
    (*corners)[k] = p_c.head<2>() / p_c.z();
  }
  return true;
}

}  // namespace

void expectMarkers(const Map& map, std::span<const int> ids, const Transform& T_w_c_before,
                   const Transform& T_w_c_now, std::vector<ExpectedMarker>* expected) {
  expected->clear();
  const Transform T_before_w = T_w_c_before.inverse();
  const Transform T_now_w = T_w_c_now.inverse();
  for (const int id : ids) {
    const MapMarker* const marker = map.findPosed(id);
    if (marker == nullptr) continue;
    const auto corners_w = marker->cornersInWorld();
    ExpectedMarker place;
    place.id = id;
    if (project(corners_w, T_before_w, &place.before) && project(corners_w, T_now_w, &place.now)) {
      expected->push_back(place);
    }
  }
}

}  // namespace waymark::slam
