// Plain lists of marker corners: a known layout, the truth of a simulation, what a map says.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "base/result.h"
#include "slam/map/map.h"

namespace waymark::io {

// Where one marker's corners are in the world, metres: top-left, top-right, bottom-right,
// bottom-left of the upright print.
struct MarkerCorners {
  int id = -1;
  double size_m = 0.0;
  std::array<Eigen::Vector3d, 4> corners;
  int piece = 0;  // of the map, whose world the corners are in
};

// The same of a natural marker: a rectangle.
struct NaturalMarkerCorners {
  std::string name;
  std::array<Eigen::Vector3d, 4> corners;
};

[[nodiscard]] std::array<Eigen::Vector3d, 4> rectangleCorners(const slam::Transform& T_w_m,
                                                              double width_m, double height_m);

// {"note":...,"markers":[{"id","size","corners"}]}, in the order given.
[[nodiscard]] Status writeMarkerLayout(const std::filesystem::path& path,
                                       std::span<const MarkerCorners> markers,
                                       std::string_view note);

// The posed markers of such a file or of a map file, sorted by id; nothing else in it is looked at.
// The error names the file, the marker and the key; an id that occurs twice is one.
[[nodiscard]] Result<std::vector<MarkerCorners>> readMarkerCorners(
    const std::filesystem::path& path);

// The posed markers of a map, sorted by id.
[[nodiscard]] std::vector<MarkerCorners> posedMarkerCorners(const slam::Map& map);
[[nodiscard]] std::vector<NaturalMarkerCorners> posedNaturalMarkerCorners(const slam::Map& map);

}  // namespace waymark::io
