// Pictures of flat sheets of markers. Tests only.
#pragma once

#include <string>
#include <vector>

#include "slam/detection/codes/dictionary.h"
#include "tools/diagnosis/grey_image.h"

namespace waymark::diagnosis::testing {

// Ids side by side and one below the other, black on white, seen square on.
inline GreyImage sheetOf(const std::string& dictionary, const std::vector<int>& ids,
                         int width = 640, int height = 480, int cell_px = 10) {
  const slam::Dictionary family = *slam::Dictionary::byName(dictionary);
  GreyImage image{width, height,
                  std::vector<std::uint8_t>(
                      static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 225)};
  const int side = family.cells() * cell_px;
  const int tile = side + 4 * cell_px;
  const int columns = width / tile;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const int left = static_cast<int>(i) % columns * tile + 2 * cell_px;
    const int top = static_cast<int>(i) / columns * tile + 2 * cell_px;
    for (int y = 0; y < side; ++y) {
      for (int x = 0; x < side; ++x) {
        const bool white = family.white(ids[i], y / cell_px, x / cell_px);
        image.pixels[static_cast<std::size_t>(top + y) * static_cast<std::size_t>(width) +
                     static_cast<std::size_t>(left + x)] = white ? 225 : 30;
      }
    }
  }
  return image;
}

// A box filter, `radius` to each side, along both axes.
inline GreyImage blurred(const GreyImage& image, int radius) {
  GreyImage from = image;
  GreyImage to = image;
  for (const bool down : {false, true}) {
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        int sum = 0;
        int count = 0;
        for (int d = -radius; d <= radius; ++d) {
          const int at_x = down ? x : x + d;
          const int at_y = down ? y + d : y;
          if (at_x < 0 || at_y < 0 || at_x >= image.width || at_y >= image.height) continue;
          sum += from.view().at(at_x, at_y);
          ++count;
        }
        to.pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                  static_cast<std::size_t>(x)] = static_cast<std::uint8_t>(sum / count);
      }
    }
    from = to;
  }
  return to;
}

}  // namespace waymark::diagnosis::testing
