// WPILib's AprilTagFieldLayout: JSON with a pose for each tag and the size of the field.
//
// The field's frame: x away from the blue alliance's wall, y left, z up, the origin in the wall's
// right corner. A tag with zero rotation is upright and faces along x: its own frame is x out of
// the print, y right, z up (all as seen by who looks at it). The file does not tell sizes; the
// family is AprilTag 36h11 or 16h5, whichever the year used.
#pragma once

#include <filesystem>
#include <string>

#include "base/result.h"
#include "io/maps/posed_markers.h"

namespace waymark::io {

// The map's world is taken as the field; length and width are `markers.field` or, where nobody has
// said it, the map's extent along x and y from the origin.
[[nodiscard]] std::string formatWpilibMap(const PosedMarkers& markers);

// `file` is for messages.
[[nodiscard]] Result<PosedMarkers> parseWpilibMap(const std::string& text,
                                                  const std::filesystem::path& file);

}  // namespace waymark::io
