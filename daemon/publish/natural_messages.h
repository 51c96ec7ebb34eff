// Messages about natural markers, from our own types. Nothing here knows about time or networks.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "daemon/frames/frame_record.h"
#include "slam/map/picture_print.h"
#include <waymark/natural_detections_t.hpp>
#include <waymark/natural_map_t.hpp>

namespace waymark::daemon {

// What subscribers are told of the configured ones, by id.
using PrintsById = std::map<int, slam::PicturePrint>;
[[nodiscard]] PrintsById byId(const std::vector<slam::PicturePrint>& prints);

// Messages are filled in place, as in messages.h. Poses stand in them bit for bit, as
// io::stableQuaternion keeps them.
void fillNaturalDetections(const FrameRecord& record, const PrintsById& prints,
                           natural_detections_t& message);

// Pieces of the natural markers of a map, each below 60 kB with names of up to 100 characters.
[[nodiscard]] int naturalPieceCount(const MapSnapshot& map);
void fillNaturalMapPiece(const MapSnapshot& map, const PrintsById& prints, std::int64_t revision,
                         int piece, natural_map_t& message);

}  // namespace waymark::daemon
