// A map as messages tell it.
#pragma once

#include <span>

#include "daemon/frames/frame_record.h"
#include "slam/map/map.h"

namespace waymark::daemon {

// All of it but the stamp, which stays; memory is kept.
void fillSnapshot(std::span<const slam::Map* const> pieces, MapSnapshot* snapshot);

}  // namespace waymark::daemon
