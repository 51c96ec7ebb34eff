// Where new features go: the best corner in each part of the image that has none (Shi and Tomasi's
// smaller eigenvalue).
#pragma once

#include <cstddef>
#include <vector>

#include "base/image_view.h"

namespace waymark::slam {

struct FoundCorner {
  int x = 0, y = 0;    // pixels
  float score = 0.0F;  // smaller eigenvalue of the mean gradient product, grey levels^2 / pixel^2
};

class CornerFinder {
 public:
  // The best corner of the part of the image from (left, top) to (right, bottom), the latter
  // excluded; score 0 where there is none. All of it at least `margin_px` from the border.
  FoundCorner best(const ImageView& image, int left, int top, int right, int bottom, int margin_px);

 private:
  std::vector<float> xx_, xy_, yy_;     // gradient products
  std::vector<float> sxx_, sxy_, syy_;  // their sums along rows
};

}  // namespace waymark::slam
