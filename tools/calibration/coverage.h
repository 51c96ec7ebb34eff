// Which parts of the picture the board's points have been in.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace waymark::calibration {

// A picture cut into equal cells, row by row from the top left.
struct ImageGrid {
  int width = 0;   // pixels
  int height = 0;  // pixels
  int columns = 10;
  int rows = 8;

  [[nodiscard]] int cells() const { return columns * rows; }
  // Of a pixel; those beyond the border count for the nearest cell.
  [[nodiscard]] int cellOf(const Eigen::Vector2d& pixel) const;
};

class Coverage {
 public:
  Coverage(int width, int height) : grid_{width, height}, counts_(grid_.cells(), 0) {}

  void add(const Eigen::Vector2d& pixel);

  // Of the cells, how many have a point: 0 to 1.
  [[nodiscard]] double share() const;
  // Ninths of the picture of which less than a third is covered, in words: "left, bottom right".
  [[nodiscard]] std::string missing() const;

  [[nodiscard]] const ImageGrid& grid() const { return grid_; }
  [[nodiscard]] const std::vector<int>& counts() const { return counts_; }

 private:
  ImageGrid grid_;
  std::vector<int> counts_;
};

}  // namespace waymark::calibration
