// Maps for viewers of meshes: PLY, ASCII, the corners as vertices and each marker as a face.
#pragma once

#include <string>

#include "io/maps/posed_markers.h"

namespace waymark::io {

// Faces go counter-clockwise as seen by who looks at the print, so that viewers show the front; the
// property `id` of a face is the marker's. Metres.
[[nodiscard]] std::string formatPlyMap(const PosedMarkers& markers);

}  // namespace waymark::io
