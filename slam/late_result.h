// An answer about a frame that comes frames later.
#pragma once

#include <cstdint>
#include <optional>

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

  // The other pose that a plane's image leaves open, where the image does not exclude it.
  struct OtherPose {
    Transform T_m_c;
    Matrix6d covariance = Matrix6d::Zero();
  };
  std::optional<OtherPose> other;
  // How much worse that explains the image, as of squares (SquarePose::ratio): 1 is a coin toss.
  double ambiguity_ratio = kUnambiguous;
  // The image alone has decided. If not, T_m_c is of use only to who knows better where the camera
  // was.
  bool decided = true;

  static constexpr double kUnambiguous = 1e6;
};

}  // namespace waymark::slam
