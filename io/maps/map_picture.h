// A picture of a map and the ways through it, seen along the axis in which they extend least; each
// piece of a map is a drawing of its own.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "base/result.h"
#include "io/maps/map_file.h"
#include "io/trajectory.h"

namespace waymark::io {

// A piece of the map: all in one world frame, metres.
struct MapDrawing {
  int piece = 0;  // told where there are several
  std::vector<MarkerCorners> markers{};
  std::vector<NaturalMarkerCorners> natural{};
  Trajectory estimate{};
  Trajectory truth{};  // may be empty
};

struct MapPicture {
  std::string title;
  std::vector<MapDrawing> pieces;  // one below the other; at least one
  // How the world is drawn upright: with z up (a surveyed world), else as the camera that it began
  // with saw it (y down, z forward).
  bool z_is_up = false;
  // The estimate is of photographs, in no order: nobody went from one to the next.
  bool photographs = false;
};

// SVG: of each piece markers with their ids or names and the direction they face, trajectories with
// their gaps, a grid, a scale bar and a legend. Equal input, equal bytes.
[[nodiscard]] std::string formatMapPicture(const MapPicture& picture);
[[nodiscard]] Status writeMapPicture(const std::filesystem::path& path, const MapPicture& picture);

}  // namespace waymark::io
