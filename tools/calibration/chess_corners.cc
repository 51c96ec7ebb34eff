#include "tools/calibration/chess_corners.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "slam/geometry/robust.h"

namespace waymark::calibration {
namespace {

using Grid = std::vector<Eigen::Vector2d>;

// OpenCV's search, good to some tenths of a pixel; row by row, as the board's own rows run.
Grid roughCorners(const ImageView& image, int across, int down) {
  const cv::Mat view(image.height, image.width, CV_8UC1,
                     const_cast<std::uint8_t*>(image.data),  // only read
                     static_cast<std::size_t>(image.stride));
  std::vector<cv::Point2f> found;
  if (!cv::findChessboardCornersSB(view, {across, down}, found, cv::CALIB_CB_NORMALIZE_IMAGE)) {
    return {};
  }
  if (std::cmp_not_equal(found.size(), across * down)) return {};
  Grid grid;
  for (const cv::Point2f& p : found) grid.emplace_back(p.x, p.y);
  // As it is seen from its front, x to the right and y down.
  const Eigen::Vector2d x = grid[1] - grid[0];
  const Eigen::Vector2d y = grid[static_cast<std::size_t>(across)] - grid[0];
  if (x.x() * y.y() - x.y() * y.x() < 0.0) {
    for (int row = 0; row < down; ++row) {
      std::reverse(grid.begin() + static_cast<std::ptrdiff_t>(row) * across,
                   grid.begin() + static_cast<std::ptrdiff_t>(row + 1) * across);
    }
  }
  return grid;
}

// From a corner to the next one along a row or a column, of both neighbours where there are two.
Eigen::Vector2d stepAt(const Grid& grid, int at, int count, int stride, std::size_t index) {
  const auto step = static_cast<std::size_t>(stride);
  if (at == 0) return grid[index + step] - grid[index];
  if (at == count - 1) return grid[index] - grid[index - step];
  return 0.5 * (grid[index + step] - grid[index - step]);
}

}  // namespace

BoardView findChessCorners(const ImageView& image, int columns, int rows,
                           const BoardDetectorOptions& options) {
  const int across = columns - 1;
  const int down = rows - 1;
  const Grid grid = roughCorners(image, across, down);
  BoardView view;
  std::vector<double> blurs;
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const int column = static_cast<int>(i) % across;
    const int row = static_cast<int>(i) / across;
    const Eigen::Vector2d right = stepAt(grid, column, across, 1, i);
    const Eigen::Vector2d below = stepAt(grid, row, down, across, i);
    const double shorter_px = std::min(right.norm(), below.norm());
    const double longer_px = std::max(right.norm(), below.norm());
    // The next corner is one step away.
    const double scale =
        std::min(options.reach * (1.0 - 2.0 * options.reach_margin_px / shorter_px),
                 options.max_reach_px / longer_px);
    if (!(scale * shorter_px >= options.min_reach_px)) continue;
    const auto saddle = fitSaddle(image, grid[i], scale * right, scale * below, options.saddles);
    if (!saddle) continue;
    view.points.push_back({i, saddle->pixel, saddle->covariance});
    blurs.push_back(saddle->blur_px);
  }
  if (!blurs.empty()) view.blur_px = slam::median(std::move(blurs));
  return view;
}

}  // namespace waymark::calibration
