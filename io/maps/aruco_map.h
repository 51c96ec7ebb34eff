// Marker maps of ArUco (MarkerMap) and UcoSLAM: OpenCV YAML with the corners of each marker.
//
// Corners in metres, in the order top-left, top-right, bottom-right, bottom-left as ArUco draws the
// marker; no frame of the marker itself. ArUco knows its own dictionaries by other names
// (TAG36h11, ARUCO); one of OpenCV's, which it has no name for, keeps ours.
#pragma once

#include <filesystem>
#include <string>

#include "base/result.h"
#include "io/maps/posed_markers.h"

namespace waymark::io {

[[nodiscard]] std::string formatArucoMap(const PosedMarkers& markers);

// `file` is for messages. A map in pixels (aruco_bc_mInfoType 0) is an error.
[[nodiscard]] Result<PosedMarkers> parseArucoMap(const std::string& text,
                                                 const std::filesystem::path& file);

}  // namespace waymark::io
