#include "slam/tracking/expected_markers.h"

#include <array>
#include <cstddef>

#include "base/sorted.h"
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

std::span<const ExpectedMarker> MarkerExpectation::update(
    const Map& map, const std::optional<Prediction>& prediction, const LocalMarkers& local,
    std::span<const MarkerFollower::Followed> followed) {
  expected_.clear();
  if (!prediction) return expected_;
  ids_.assign(local.ids().begin(), local.ids().end());
  for (const auto& marker : followed) ids_.push_back(marker.measured.detection.id);
  sortUnique(&ids_);
  for (const int id : ids_) {
    const MapMarker* const marker = map.findPosed(id);
    if (marker == nullptr) continue;
    const auto corners_w = marker->cornersInWorld();
    ExpectedMarker place;
    place.id = id;
    if (project(corners_w, prediction->T_w_last, &place.before) &&
        project(corners_w, prediction->T_w_c, &place.now)) {
      expected_.push_back(place);
    }
  }
  return expected_;
}

}  // namespace waymark::slam
