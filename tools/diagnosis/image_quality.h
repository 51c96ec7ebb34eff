// What an image says of light, focus and motion, without knowing what is in it.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "base/image_view.h"
#include "tools/diagnosis/grey_image.h"

namespace waymark::diagnosis {

struct ImageQuality {
  // Grey levels that 1 %, 50 % and 99 % of the pixels are not brighter than.
  int dark = 0, median = 0, bright = 0;
  double saturated = 0.0;  // share of pixels at 250 and more
  // How wide the sharpest edges are, from dark to bright, pixels: 2 in a sharp image, 2.5 times the
  // sigma of what blurs it. 0: nothing in the image has an edge that could tell.
  double edge_width_px = 0.0;
};

[[nodiscard]] ImageQuality measureQuality(const ImageView& image);

// The median of each number; nothing of no images.
[[nodiscard]] ImageQuality medianQuality(std::span<const GreyImage> images);

struct QualityLimits {
  int dark_below = 60;           // grey levels; 99 % of the pixels below it are a dark image
  double saturated_above = 0.3;  // share of the image
  int flat_below = 25;           // grey levels between the 1 % and the 99 %: there is nothing in it
  // Cells of a marker are some pixels wide; edges wider than this take their corners away.
  double wide_edges_px = 6.0;
};

// What is wrong and what would help, one line each; nothing of good images.
[[nodiscard]] std::vector<std::string> qualityAdvice(const ImageQuality& quality,
                                                     const QualityLimits& limits = {});

}  // namespace waymark::diagnosis
