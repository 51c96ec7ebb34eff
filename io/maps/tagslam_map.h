// TagSLAM's tagslam.yaml: bodies with tags, poses as positions and rotation vectors.
//
// The tag's frame is ours (x right, y up, z out of the print); T_body_tag is given, and with the
// body's own pose in the world, T_world_body, the marker's follows.
#pragma once

#include <filesystem>
#include <string>

#include "base/result.h"
#include "io/maps/posed_markers.h"

namespace waymark::io {

// One static body at the world's origin, with noises that make TagSLAM trust the map.
[[nodiscard]] std::string formatTagslamMap(const PosedMarkers& markers);

// The tags with a pose on the static bodies with a pose (where a static body has none, its frame is
// the world). Others are left out. `file` is for messages.
[[nodiscard]] Result<PosedMarkers> parseTagslamMap(const std::string& text,
                                                   const std::filesystem::path& file);

}  // namespace waymark::io
