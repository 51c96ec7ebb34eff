#include "io/maps/posed_markers.h"

#include <string>

#include "io/text/plausible.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/detection/marker_detection.h"
#include "slam/geometry/align_points.h"

namespace waymark::io {

PosedMarkers posedMarkers(const slam::Map& map) {
  PosedMarkers result;
  result.dictionary = map.dictionary;
  for (const auto& [id, marker] : map.markers()) {
    if (!marker.T_w_m || slam::isPicture(id)) continue;
    result.markers.push_back({id, marker.size_m, *marker.T_w_m});
  }
  return result;
}

Result<PosedMarker> markerAtCorners(int id, const std::array<Eigen::Vector3d, 4>& corners) {
  PosedMarker marker;
  marker.id = id;
  for (std::size_t k = 0; k < 4; ++k) {
    marker.size_m += 0.25 * (corners[(k + 1) % 4] - corners[k]).norm();
  }
  const auto square = slam::markerCorners(marker.size_m);
  marker.T_w_m = slam::alignPoints(square, corners);
  for (std::size_t k = 0; k < 4; ++k) {
    constexpr double kMaxPerSide = 0.01;
    const double error_m = (marker.T_w_m * square[k] - corners[k]).norm();
    if (!(error_m <= kMaxPerSide * marker.size_m) || !(marker.size_m > 0.0)) {
      return Error{"are not the corners of a square"};
    }
  }
  return marker;
}

Result<slam::Map> mapOf(const PosedMarkers& markers, const std::filesystem::path& file) {
  const auto fault = [&file](int id, const std::string& reason) {
    return Error{file.string() + ": marker " + std::to_string(id) + ": " + reason};
  };
  slam::Map map;
  map.dictionary = markers.dictionary;
  const int count = slam::Dictionary::byName(markers.dictionary)->size();
  for (const PosedMarker& posed : markers.markers) {
    if (posed.id < 0 || posed.id >= count) {
      return fault(posed.id, "is not in " + markers.dictionary + ", which ends with " +
                                 std::to_string(count - 1));
    }
    if (map.find(posed.id) != nullptr) return fault(posed.id, "occurs twice");
    if (!(posed.size_m > 0.0)) return fault(posed.id, "has no size; give one with --size");
    if (!isSize(posed.size_m)) return fault(posed.id, std::string("its size ") + kSizes);
    if (!isPosition(posed.T_w_m.p)) return fault(posed.id, kPositions);
    map.addMarker(posed.id, posed.size_m);
    map.place(posed.id, posed.T_w_m);
  }
  if (map.markers().empty()) return Error{file.string() + ": has no markers"};
  return map;
}

}  // namespace waymark::io
