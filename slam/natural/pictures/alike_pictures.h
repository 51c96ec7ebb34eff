// Which pictures of a set look alike: the same features in the same places.
#pragma once

#include <span>
#include <vector>

#include "slam/natural/pictures/descriptor_index.h"
#include "slam/natural/pictures/natural_marker.h"

namespace waymark::slam {

struct AlikePictures {
  int first = -1;  // places in the set, first < second
  int second = -1;
  int shared = 0;      // features that both have
  double share = 0.0;  // of those of the picture that has fewer
};

// All pairs that share at least that much, by their places. Time grows with the number of
// pictures, not with that of pairs.
[[nodiscard]] std::vector<AlikePictures> findAlike(std::span<const NaturalMarker> markers,
                                                   double least_share = 0.25,
                                                   const DescriptorIndexOptions& options = {});

}  // namespace waymark::slam
