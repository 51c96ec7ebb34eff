// Where in the image corners of markers have been: elsewhere a lens that is learned is known by its
// prior alone.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/image_grid.h"

namespace waymark::slam {

class CornerCoverage {
 public:
  // Of images of this size, pixels.
  CornerCoverage(int width, int height)
      : grid_{width, height}, seen_(static_cast<std::size_t>(grid_.cells()), false) {}

  // How many cells have their first corner now.
  [[nodiscard]] int add(std::span<const MarkerDetection> detections) {
    int first = 0;
    for (const MarkerDetection& detection : detections) {
      for (const Eigen::Vector2d& pixel : detection.pixels) {
        auto cell = seen_[static_cast<std::size_t>(grid_.cellOf(pixel))];
        if (!cell) ++first;
        cell = true;
      }
    }
    return first;
  }

  static constexpr int kCells = ImageGrid{}.columns * ImageGrid{}.rows;

 private:
  ImageGrid grid_;
  std::vector<bool> seen_;
};

}  // namespace waymark::slam
