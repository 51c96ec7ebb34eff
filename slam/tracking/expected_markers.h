// Where the map has markers in the frame to come: what detection follows them by.
#pragma once

#include <span>
#include <vector>

#include "slam/detection/search/marker_follower.h"
#include "slam/geometry/transform.h"
#include "slam/map/map.h"

namespace waymark::slam {

// Those of the markers `ids` (sorted) that have a pose and are wholly in front of the camera both
// where it was and where it is expected now; sorted by id.
void expectMarkers(const Map& map, std::span<const int> ids, const Transform& T_w_c_before,
                   const Transform& T_w_c_now, std::vector<ExpectedMarker>* expected);

}  // namespace waymark::slam
