// Which parts of the picture the board's points have been in.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/image_grid.h"

namespace waymark::calibration {

using slam::ImageGrid;

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
