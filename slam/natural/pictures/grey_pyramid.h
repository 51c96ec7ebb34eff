// Grey levels at full size and halved again and again.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "base/image_view.h"

namespace waymark::slam {

// Row-major grey levels, 0 to 255, pixel centres at integers.
struct GreyLevels {
  int width = 0;
  int height = 0;
  std::vector<float> grey;

  [[nodiscard]] const float* row(int y) const {
    return grey.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
  }
  [[nodiscard]] float* row(int y) {
    return grey.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
  }
  // Between the pixels, linearly; beyond the outermost centres as at them. Precondition: at least
  // two pixels each way.
  [[nodiscard]] float at(float x, float y) const {
    x = std::clamp(x, 0.0F, static_cast<float>(width) - 1.001F);
    y = std::clamp(y, 0.0F, static_cast<float>(height) - 1.001F);
    const int column = static_cast<int>(x);
    const int line = static_cast<int>(y);
    const float fx = x - static_cast<float>(column);
    const float fy = y - static_cast<float>(line);
    const float* p = row(line) + column;
    const float* q = p + width;
    const float top = p[0] + fx * (p[1] - p[0]);
    const float low = q[0] + fx * (q[1] - q[0]);
    return top + fy * (low - top);
  }
};

// Level i has 1 / 2^i of the size; each of its pixels is the mean of four of the level below.
class GreyPyramid {
 public:
  GreyPyramid() = default;
  // Levels go on as long as both sides have at least `min_side_px`; the first is there anyway.
  GreyPyramid(ImageView image, int min_side_px);

  [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }
  [[nodiscard]] const GreyLevels& level(int i) const {
    return levels_[static_cast<std::size_t>(i)];
  }

  // Where a pixel of full size lies in level i, and the way back.
  [[nodiscard]] static double toLevel(double full, int i) {
    const double scale = static_cast<double>(1 << i);
    return (full + 0.5) / scale - 0.5;
  }
  [[nodiscard]] static double toFull(double in_level, int i) {
    const double scale = static_cast<double>(1 << i);
    return (in_level + 0.5) * scale - 0.5;
  }

 private:
  std::vector<GreyLevels> levels_;
};

}  // namespace waymark::slam
