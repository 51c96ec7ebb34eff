// An image in equal cells: which parts of it have been seen something in.
#pragma once

#include <algorithm>

#include <Eigen/Core>

namespace waymark::slam {

// Row by row from the top left.
struct ImageGrid {
  int width = 0;   // pixels
  int height = 0;  // pixels
  int columns = 10;
  int rows = 8;

  [[nodiscard]] int cells() const { return columns * rows; }
  // Of a pixel; those beyond the border count for the nearest cell.
  [[nodiscard]] int cellOf(const Eigen::Vector2d& pixel) const {
    // Pixels count from centres: the image begins at -0.5.
    const auto column = static_cast<int>((pixel.x() + 0.5) / width * columns);
    const auto row = static_cast<int>((pixel.y() + 0.5) / height * rows);
    return std::clamp(row, 0, rows - 1) * columns + std::clamp(column, 0, columns - 1);
  }
};

}  // namespace waymark::slam
