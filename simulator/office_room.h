// A furnished office, 6 x 5 x 2.7 m: windows in the east, shelves and a door in the south, pictures
// and a board in the west. World frame: on the floor in its middle, x to the east, y to the north.
#pragma once

#include "simulator/scene_builders.h"

namespace waymark::simulator {

struct OfficeRoom {
  Surface north, east, south, west;
};

// Without markers: there is room for them at eye height on the north wall, at x = -1.1, 0.1 and
// 1.2, and on the others where office_room.cc says.
[[nodiscard]] OfficeRoom addOfficeRoom(const Build& build, Random* random);

// Hangs the next marker on the wall at a point of the world, nearly upright.
void hangMarkerAt(const Build& build, const Surface& wall, const Eigen::Vector3d& p_w,
                  Random* random);

}  // namespace waymark::simulator
