// What is in a map, for people.
#pragma once

#include <map>
#include <string>

#include "io/maps/map_file.h"

namespace waymark::tools {

struct ReprojectionFit {
  std::size_t corners = 0;
  double rms_px = 0.0;  // 0 without corners
};

// How well the posed markers of the first piece explain the pixels of the keyframes, as a whole and
// by marker. Corners that the camera cannot see at all in the map (behind it) are left out.
[[nodiscard]] ReprojectionFit reprojectionFit(const io::MapFile& file);
[[nodiscard]] std::map<int, ReprojectionFit> reprojectionFitByMarker(const io::MapFile& file);

// Several lines; with_markers adds one for each marker. Of a map in pieces those of each, under its
// number.
[[nodiscard]] std::string mapInfo(const io::MapFile& file, bool with_markers);

}  // namespace waymark::tools
