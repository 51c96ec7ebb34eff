// An answer about a frame that comes frames later.
#pragma once

#include <cstdint>

#include "slam/geometry/transform.h"

namespace waymark::slam {

// What somebody else has found out about an earlier frame (a relocalizer in a thread of its own):
// the camera in the frame of what it saw, never in the world, so that a correction of the map in
// between cannot make it stale.
struct LateResult {
  std::uint64_t sequence = 0;    // the frame's
  std::uint64_t generation = 0;  // of the SLAM that the frame went to: others ignore it
  int landmark = -1;             // what was seen: its id in the map
  Transform T_m_c;
  Matrix6d covariance = Matrix6d::Zero();  // of (dp, dtheta) of T_m_c: metres, radians
};

}  // namespace waymark::slam
