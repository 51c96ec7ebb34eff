// Points of a picture that the filter may track from the start, their places on the print being
// known (seed 2, section 3.1 and Figure 3).
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "slam/natural/pictures/natural_marker.h"

namespace waymark::slam {

struct PicturePointsOptions {
  int most = 12;
  // Corners that are taken into account: this share of all, the most distinct ones (the paper's).
  double best_share = 0.1;
  // At least, where that share is fewer.
  int least_considered = 24;
  // From each other and from the picture's edge, parts of its shorter side.
  double apart = 0.06;
  // The picture at about this size, pixels of the longer side: as it is seen.
  int side_px = 256;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// On the print (x right, y up, metres). First the nearest to each of the picture's corners, as in
// the paper; then, again and again, the one that is farthest from all taken before. Fewer where the
// picture has not so many.
[[nodiscard]] std::vector<Eigen::Vector2d> picturePoints(const NaturalMarker& marker,
                                                         const PicturePointsOptions& options = {});

}  // namespace waymark::slam
