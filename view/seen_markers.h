// What was seen in one frame, as JSON: markers with where the map and the pose put them, the image
// that a preview message brings, and a board for calibration.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>

#include "io/text/json_node.h"
#include "slam/geometry/camera_model.h"
#include <waymark/calibration_t.hpp>
#include <waymark/detections_t.hpp>
#include <waymark/lens_t.hpp>
#include <waymark/map_t.hpp>
#include <waymark/natural_detection_t.hpp>
#include <waymark/natural_map_t.hpp>
#include <waymark/pose_t.hpp>
#include <waymark/preview_t.hpp>

namespace waymark::view {

// Each with "id", "hamming" and "corners"; and with "expected", the corners where the map has the
// marker, seen through the lens from the pose. That is left out where one of them is not known, or
// the pose is of another frame. pose, lens: may be null.
[[nodiscard]] io::Json seenMarkers(const detections_t& detections, const pose_t* pose,
                                   const lens_t* lens, const std::map<std::int32_t, map_t>& map);

// A natural marker as it was found last, and the time of the frame with which that took effect:
// what is found in a frame is told some frames later.
struct FoundPicture {
  natural_detection_t detection{};
  std::int64_t monotonic_ns = 0;
};
using FoundPictures = std::map<std::int32_t, FoundPicture>;  // by id

// The natural markers of the map in a frame, each with "name", "lately" (it was found within a
// second) and at least one of "corners", where it was found in that very frame, and "expected",
// as of seenMarkers(), where it faces the camera and its middle is in the image.
[[nodiscard]] io::Json seenPictures(const detections_t& frame, const pose_t* pose,
                                    const lens_t* lens,
                                    const std::map<std::int32_t, natural_map_t>& map,
                                    const FoundPictures& found);
// Metres. One whose print nobody has described is told without: as high as it is wide, then.
[[nodiscard]] double pictureHeight(const natural_marker_t& marker);

// Empty where nothing is known of the lens.
[[nodiscard]] std::optional<slam::Calibration> calibrationOf(const lens_t& lens);

// Whether a preview is what waymarkd sends: anybody can send on a channel.
[[nodiscard]] bool isPlausible(const preview_t& preview);
// {"type":"preview", ...} with the image as a data URL. Precondition: isPlausible().
[[nodiscard]] io::Json previewJson(const preview_t& preview);

// The same of a calibration.
[[nodiscard]] bool isPlausible(const calibration_t& calibration);
// What of the board is in its frame, and where in the image it has been: {"points":[[x,y], ...],
// "columns", "rows", "cells":[...]}. Precondition: isPlausible().
[[nodiscard]] io::Json boardJson(const calibration_t& calibration);
// Of the image's cells, how many the board has been in: 0 to 1.
[[nodiscard]] double coveredShare(const calibration_t& calibration);

[[nodiscard]] std::string base64(std::span<const std::uint8_t> bytes);

}  // namespace waymark::view
