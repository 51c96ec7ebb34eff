// Which pictures are worth looking for: those near the last known place (seed 2, section 3.1).
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slam/geometry/transform.h"

namespace waymark::slam {

struct NearbyPicturesOptions {
  // The paper's number, which kept its search at 3 images a second.
  int most = 20;
  // How far the camera may be from where it is believed to be, sigma of its position.
  double sigmas = 3.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// Places in the set, ascending, of all that may be among the `most` nearest to the camera, given
// how well its position is known; those whose own place is not known are always among them. Empty
// means all: there is no last place, or nothing to choose from. position_covariance: metres
// squared, in the world.
[[nodiscard]] std::vector<int> nearbyPictures(std::span<const std::optional<Transform>> T_w_m,
                                              const std::optional<Transform>& T_w_c,
                                              const Eigen::Matrix3d& position_covariance,
                                              const NearbyPicturesOptions& options = {});

}  // namespace waymark::slam
