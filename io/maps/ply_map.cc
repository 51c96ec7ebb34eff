#include "io/maps/ply_map.h"

#include "io/text/number_text.h"
#include "slam/detection/marker_detection.h"

namespace waymark::io {

std::string formatPlyMap(const PosedMarkers& markers) {
  const std::size_t count = markers.markers.size();
  std::string text = "ply\nformat ascii 1.0\ncomment " + markers.dictionary + ", metres\n";
  text += "element vertex " + std::to_string(4 * count) + "\n";
  text += "property double x\nproperty double y\nproperty double z\n";
  text += "element face " + std::to_string(count) + "\n";
  text += "property list uchar int vertex_indices\nproperty int id\nend_header\n";
  for (const PosedMarker& marker : markers.markers) {
    for (const Eigen::Vector3d& corner : slam::markerCorners(marker.size_m)) {
      const Eigen::Vector3d p = marker.T_w_m * corner;
      text += roundTrip(p.x()) + " " + roundTrip(p.y()) + " " + roundTrip(p.z()) + "\n";
    }
  }
  for (std::size_t i = 0; i < count; ++i) {
    text += "4";
    for (std::size_t k = 4; k-- > 0;) text += " " + std::to_string(4 * i + k);
    text += " " + std::to_string(markers.markers[i].id) + "\n";
  }
  return text;
}

}  // namespace waymark::io
