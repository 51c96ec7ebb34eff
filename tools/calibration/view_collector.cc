#include "tools/calibration/view_collector.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "slam/geometry/homography.h"
#include "slam/geometry/robust.h"
#include "tools/calibration/plane_homography.h"

namespace waymark::calibration {

ViewCollector::ViewCollector(const Board& board, int width, int height,
                             const ViewCollectorOptions& options)
    : board_(board),
      options_(options),
      diagonal_px_(std::hypot(width, height)),
      coverage_(width, height) {
  Eigen::Vector2d low = board.points().front().head<2>();
  Eigen::Vector2d high = low;
  for (const Eigen::Vector3d& point : board.points()) {
    low = low.cwiseMin(point.head<2>());
    high = high.cwiseMax(point.head<2>());
  }
  board_corners_ = {low, Eigen::Vector2d(high.x(), low.y()), high,
                    Eigen::Vector2d(low.x(), high.y())};
}

ViewCollector::Signature ViewCollector::signatureOf(const BoardView& board_view) const {
  std::vector<Eigen::Vector2d> on_board;
  std::vector<Eigen::Vector2d> pixels;
  for (const BoardPoint& point : board_view.points) {
    on_board.emplace_back(board_.points()[point.index].head<2>());
    pixels.push_back(point.pixel);
  }
  const auto H = fitHomography(on_board, pixels);
  Signature signature;
  for (std::size_t k = 0; k < 4; ++k) {
    signature[k] = H ? slam::applyHomography(*H, board_corners_[k]) : pixels[k];
    // What lies far outside is far extrapolated.
    signature[k] = signature[k].cwiseMax(-0.5 * diagonal_px_).cwiseMin(1.5 * diagonal_px_);
  }
  return signature;
}

double ViewCollector::distance(const Signature& a, const Signature& b) const {
  double squared = 0.0;
  for (std::size_t k = 0; k < 4; ++k) squared += (a[k] - b[k]).squaredNorm();
  return std::sqrt(squared / 4.0) / diagonal_px_;
}

void ViewCollector::offer(std::string name, BoardView board_view, const ImageView& image) {
  for (const BoardPoint& point : board_view.points) coverage_.add(point.pixel);
  const Signature signature = signatureOf(board_view);
  Kept* nearest = nullptr;
  double nearest_distance = std::numeric_limits<double>::infinity();
  for (Kept& kept : views_) {
    const double d = distance(kept.signature, signature);
    if (d >= nearest_distance) continue;
    nearest = &kept;
    nearest_distance = d;
  }
  const bool is_new = nearest_distance >= options_.novelty;
  if (!is_new && board_view.blur_px > options_.sharper * nearest->view.board_view.blur_px) return;

  View view{std::move(name), std::move(board_view), image.width, image.height, {}};
  for (int y = 0; y < image.height; ++y) {
    view.pixels.insert(view.pixels.end(), image.row(y), image.row(y) + image.width);
  }
  if (is_new) {
    views_.push_back({std::move(view), signature});
  } else {
    *nearest = {std::move(view), signature};
  }
  while (views_.size() > options_.max_views) thinOut();
}

void ViewCollector::thinOut() {
  constexpr double kGrowth = 1.1;
  options_.novelty *= kGrowth;
  std::vector<Kept> left;
  for (Kept& kept : views_) {
    const bool is_new = std::none_of(left.begin(), left.end(), [&](const Kept& other) {
      return distance(kept.signature, other.signature) < options_.novelty;
    });
    if (is_new) left.push_back(std::move(kept));
  }
  views_ = std::move(left);
}

double ViewCollector::worstBlur() const {
  std::vector<double> blurs;
  for (const Kept& kept : views_) blurs.push_back(kept.view.board_view.blur_px);
  if (blurs.empty()) return std::numeric_limits<double>::infinity();
  return options_.worst_blur * slam::median(std::move(blurs));
}

std::vector<View> ViewCollector::take() && {
  const double worst_px = worstBlur();
  std::vector<View> views;
  for (Kept& kept : views_) {
    if (kept.view.board_view.blur_px <= worst_px) views.push_back(std::move(kept.view));
  }
  return views;
}

}  // namespace waymark::calibration
