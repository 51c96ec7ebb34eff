// Markers and where they hang, without keyframes: what maps of other programs consist of.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "base/result.h"
#include "slam/geometry/transform.h"
#include "slam/map/map.h"

namespace waymark::io {

struct PosedMarker {
  int id = -1;
  double size_m = 0.0;  // 0 where the file does not say
  slam::Transform T_w_m;
};

// Of a playing field whose corner is the world's origin: along x and along y.
struct FieldSize {
  double length_m = 0.0;
  double width_m = 0.0;

  bool operator==(const FieldSize&) const = default;
};

struct PosedMarkers {
  std::string dictionary;  // empty where the file does not say, or says what we do not know
  std::vector<PosedMarker> markers;
  std::optional<FieldSize> field{};  // where the file says
};

// The posed markers of a map, sorted by id.
[[nodiscard]] PosedMarkers posedMarkers(const slam::Map& map);

// The marker that has these corners (top-left, top-right, bottom-right, bottom-left), or why there
// is none: the sides of a square are equal within 1 %.
[[nodiscard]] Result<PosedMarker> markerAtCorners(int id,
                                                  const std::array<Eigen::Vector3d, 4>& corners);

// A map without keyframes. An id that occurs twice or that the dictionary does not have, and a
// missing size, are errors that name the file. Precondition: the dictionary is a known one.
[[nodiscard]] Result<slam::Map> mapOf(const PosedMarkers& markers,
                                      const std::filesystem::path& file);

}  // namespace waymark::io
