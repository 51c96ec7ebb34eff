// What was seen in one frame, as JSON: markers with where the map and the pose put them, and the
// image that a preview message brings.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "io/text/json_node.h"
#include <waymark/detections_t.hpp>
#include <waymark/lens_t.hpp>
#include <waymark/map_t.hpp>
#include <waymark/pose_t.hpp>
#include <waymark/preview_t.hpp>

namespace waymark::view {

// Each with "id", "hamming" and "corners"; and with "expected", the corners where the map has the
// marker, seen through the lens from the pose. That is left out where one of them is not known, or
// the pose is of another frame. pose, lens: may be null.
[[nodiscard]] io::Json seenMarkers(const detections_t& detections, const pose_t* pose,
                                   const lens_t* lens, const std::map<std::int32_t, map_t>& map);

// Whether a preview is what waymarkd sends: anybody can send on a channel.
[[nodiscard]] bool isPlausible(const preview_t& preview);
// {"type":"preview", ...} with the image as a data URL. Precondition: isPlausible().
[[nodiscard]] io::Json previewJson(const preview_t& preview);

[[nodiscard]] std::string base64(std::span<const std::uint8_t> bytes);

}  // namespace waymark::view
