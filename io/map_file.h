// Maps as JSON: the SLAM's own (map.json), and plain lists of marker corners (a known layout, the
// truth of a simulation).
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "base/result.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"

namespace waymark::io {

// Where one marker's corners are in the world, metres: top-left, top-right, bottom-right,
// bottom-left of the upright print.
struct MarkerCorners {
  int id = -1;
  double size_m = 0.0;
  std::array<Eigen::Vector3d, 4> corners;
};

// map.json: {"format":"waymark-map","version":1,"dictionary",...,"camera":{...},"markers":[...],
// "unposed_markers":[...],"keyframes":[...]}, one marker or keyframe a line. Everything needed to
// go on with the map later is in it. Equal maps, equal bytes. Precondition: all numbers are finite.
[[nodiscard]] std::string formatMap(const slam::Map& map, const slam::Calibration& camera);

// {"note":...,"markers":[{"id","size","corners"}]}, in the order given.
[[nodiscard]] Status writeMarkerLayout(const std::filesystem::path& path,
                                       std::span<const MarkerCorners> markers,
                                       std::string_view note);

// The posed markers of either kind of file, sorted by id. The error names the file, the marker and
// the key; an id that occurs twice is one.
[[nodiscard]] Result<std::vector<MarkerCorners>> readMarkerCorners(
    const std::filesystem::path& path);

// The posed markers of a map, sorted by id.
[[nodiscard]] std::vector<MarkerCorners> posedMarkerCorners(const slam::Map& map);

}  // namespace waymark::io
