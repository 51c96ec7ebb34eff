// The painted surface: smooth noise with papers and stains on it, baked into an image.
#pragma once

#include <cstdint>
#include <vector>

#include "simulator/scene.h"

namespace waymark::simulator {

// Grey levels over a surface, row 0 at its top. Blurred by about a texel, so that bilinear lookup
// shows no steps.
class Texture {
 public:
  Texture(const Surface& surface, std::uint64_t seed);

  // At (x, y) of the surface's frame, metres; clamped at its edges.
  [[nodiscard]] float at(float x, float y) const {
    const float column = clampTo((x + half_width_) * per_texel_ - 0.5F, last_column_);
    const float row = clampTo((half_height_ - y) * per_texel_ - 0.5F, last_row_);
    const int c = static_cast<int>(column);
    const int r = static_cast<int>(row);
    const float fc = column - static_cast<float>(c);
    const float fr = row - static_cast<float>(r);
    const std::uint8_t* p = texels_.data() + static_cast<std::size_t>(r) * width_ + c;
    const float top = static_cast<float>(p[0]) + fc * (static_cast<float>(p[1]) - p[0]);
    const float low =
        static_cast<float>(p[width_]) + fc * (static_cast<float>(p[width_ + 1]) - p[width_]);
    return top + fr * (low - top);
  }

 private:
  static float clampTo(float value, float last) {
    return value < 0.0F ? 0.0F : (value > last ? last : value);
  }

  float half_width_ = 0.0F;   // metres
  float half_height_ = 0.0F;  // metres
  float per_texel_ = 0.0F;    // texels per metre
  float last_column_ = 0.0F;  // where the last pair of texels begins
  float last_row_ = 0.0F;
  std::size_t width_ = 0;  // texels
  std::vector<std::uint8_t> texels_;
};

}  // namespace waymark::simulator
