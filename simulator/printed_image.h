// A picture as it is printed: grey levels, to be looked up at any size.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "base/image_view.h"

namespace waymark::simulator {

// Grey levels as they reach the sensor in full light. Made once, then only read.
class PrintedImage {
 public:
  // A print reflects from `ink` (grey level 0 of the picture) to `paper` (level 255).
  explicit PrintedImage(ImageView picture, double ink = 25.0, double paper = 215.0);

  [[nodiscard]] int width() const { return levels_.front().width; }  // pixels of the picture
  [[nodiscard]] int height() const { return levels_.front().height; }

  // The picture halved so often that its pixels are as large as `spacing` pixels of its full size.
  [[nodiscard]] int levelFor(float spacing) const {
    const int last = static_cast<int>(levels_.size()) - 1;
    return spacing > 1.0F ? std::min(last, static_cast<int>(std::lround(std::log2(spacing)))) : 0;
  }
  [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }
  // At (x, y) pixels from the top-left CORNER of the full-size picture; clamped at its edges.
  [[nodiscard]] float at(int level, float x, float y) const {
    const Level& l = levels_[static_cast<std::size_t>(level)];
    const float column = clampTo(x * l.scale_x - 0.5F, static_cast<float>(l.width) - 1.001F);
    const float row = clampTo(y * l.scale_y - 0.5F, static_cast<float>(l.height) - 1.001F);
    const auto c = static_cast<std::size_t>(column);
    const auto r = static_cast<std::size_t>(row);
    const float fc = column - static_cast<float>(c);
    const float fr = row - static_cast<float>(r);
    const auto width = static_cast<std::size_t>(l.width);
    const float* p = l.grey.data() + r * width + c;
    const float top = p[0] + fc * (p[1] - p[0]);
    const float low = p[width] + fc * (p[width + 1] - p[width]);
    return top + fr * (low - top);
  }

 private:
  struct Level {
    int width;
    int height;
    float scale_x;  // of full size
    float scale_y;
    std::vector<float> grey;
  };
  static float clampTo(float value, float last) {
    return value < 0.0F ? 0.0F : (value > last ? last : value);
  }

  std::vector<Level> levels_;
};

}  // namespace waymark::simulator
