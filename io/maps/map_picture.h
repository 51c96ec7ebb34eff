// A picture of a map and the ways through it, seen along the axis in which they extend least.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "base/result.h"
#include "io/maps/map_file.h"
#include "io/trajectory.h"

namespace waymark::io {

// All in one world frame, metres.
struct MapPicture {
  std::string title;
  std::vector<MarkerCorners> markers;
  Trajectory estimate;
  Trajectory truth;  // may be empty
  // How the world is drawn upright: with z up (a surveyed world), else as the camera that it began
  // with saw it (y down, z forward).
  bool z_is_up = false;
  // The estimate is of photographs, in no order: nobody went from one to the next.
  bool photographs = false;
};

// SVG: markers with their ids and the direction they face, trajectories with their gaps, a grid, a
// scale bar and a legend. Equal input, equal bytes.
[[nodiscard]] std::string formatMapPicture(const MapPicture& picture);
[[nodiscard]] Status writeMapPicture(const std::filesystem::path& path, const MapPicture& picture);

}  // namespace waymark::io
