// Grey levels at full size and halved again and again.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/image_view.h"

namespace waymark::slam {

// Row-major grey levels, 0 to 255, pixel centres at integers. Pictures are kept as bytes, as there
// may be a thousand of them.
template <typename Grey>
struct GreyImage {
  int width = 0;
  int height = 0;
  std::vector<Grey> grey;

  [[nodiscard]] const Grey* row(int y) const {
    return grey.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
  }
  [[nodiscard]] Grey* row(int y) {
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
    const Grey* p = row(line) + column;
    const Grey* q = p + width;
    const float top = static_cast<float>(p[0]) + fx * static_cast<float>(p[1] - p[0]);
    const float low = static_cast<float>(q[0]) + fx * static_cast<float>(q[1] - q[0]);
    return top + fy * (low - top);
  }
};

// Level i has 1 / 2^i of the size; each of its pixels is the mean of four of the level below.
template <typename Grey>
class GreyPyramidOf {
 public:
  GreyPyramidOf() = default;
  // Levels go on as long as both sides have at least `min_side_px`; the first is there anyway.
  GreyPyramidOf(ImageView image, int min_side_px);

  [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }
  [[nodiscard]] const GreyImage<Grey>& level(int i) const {
    return levels_[static_cast<std::size_t>(i)];
  }

 private:
  std::vector<GreyImage<Grey>> levels_;
};

using GreyLevels = GreyImage<float>;
using GreyPyramid = GreyPyramidOf<float>;            // of the camera's image
using PicturePyramid = GreyPyramidOf<std::uint8_t>;  // of a print

// Where a pixel of full size lies in level i, and the way back.
[[nodiscard]] inline double toLevel(double full, int i) {
  return (full + 0.5) / static_cast<double>(1 << i) - 0.5;
}
[[nodiscard]] inline double toFull(double in_level, int i) {
  return (in_level + 0.5) * static_cast<double>(1 << i) - 0.5;
}

}  // namespace waymark::slam
