// Pictures such as hang on walls, made up from a seed.
#pragma once

#include <cstdint>
#include <vector>

#include "base/image_view.h"

namespace waymark::simulator {

// What is on it.
enum class PosterStyle {
  kText,    // a headline, a picture and paragraphs
  kShapes,  // flat coloured shapes, a few large and more small ones
  kPhoto,   // soft light, clouds, objects with shading
};

struct PosterImage {
  int width = 0;   // pixels
  int height = 0;  // pixels
  std::vector<std::uint8_t> grey;

  [[nodiscard]] ImageView view() const { return {grey.data(), width, height, width}; }
};

// Equal seeds give equal posters; different ones have nothing but the style in common.
[[nodiscard]] PosterImage makePoster(PosterStyle style, std::uint64_t seed, int width = 600,
                                     int height = 800);
// The seed decides on the style as well.
[[nodiscard]] PosterImage makePoster(std::uint64_t seed, int width = 600, int height = 800);

}  // namespace waymark::simulator
