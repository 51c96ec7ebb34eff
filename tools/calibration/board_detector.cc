#include "tools/calibration/board_detector.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "slam/geometry/homography.h"
#include "slam/geometry/robust.h"
#include "tools/calibration/chess_corners.h"
#include "tools/calibration/plane_homography.h"

namespace waymark::calibration {
namespace {

Eigen::Vector2d centreOf(const std::array<Eigen::Vector2d, 4>& corners) {
  return 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
}

Eigen::Vector3d centreOf(const BoardMarker& marker) {
  return 0.25 * (marker.corners[0] + marker.corners[1] + marker.corners[2] + marker.corners[3]);
}

// Where a point of the board lies in a marker's own coordinates: (0, 0) top-left, (1, 1)
// bottom-right.
Eigen::Vector2d inMarker(const BoardMarker& marker, const Eigen::Vector3d& point) {
  const Eigen::Vector3d right = marker.corners[1] - marker.corners[0];
  const Eigen::Vector3d down = marker.corners[3] - marker.corners[0];
  const Eigen::Vector3d p = point - marker.corners[0];
  return {p.dot(right) / right.squaredNorm(), p.dot(down) / down.squaredNorm()};
}

double medianBlur_px(const std::vector<slam::MeasuredMarker>& measured) {
  std::vector<double> blurs;
  for (const slam::MeasuredMarker& marker : measured) {
    for (const slam::EdgeFit& edge : marker.edges) blurs.push_back(marker.factor * edge.blur_px);
  }
  return blurs.empty() ? 0.0 : slam::median(std::move(blurs));
}

}  // namespace

slam::Calibration roughCalibration(int width, int height) {
  slam::Calibration c;
  c.width = width;
  c.height = height;
  c.fx = c.fy = width;
  c.cx = 0.5 * (width - 1);
  c.cy = 0.5 * (height - 1);
  return c;
}

BoardDetector::BoardDetector(const Board& board, const slam::Calibration& camera,
                             const BoardDetectorOptions& options)
    : board_(board),
      camera_(camera),
      detector_(camera_, *slam::Dictionary::byName(board.dictionary()), options.markers),
      options_(options) {}

std::vector<BoardDetector::Seen> BoardDetector::seenMarkers(const ImageView& image) {
  std::map<int, std::size_t> index_of;
  for (std::size_t i = 0; i < board_.markers().size(); ++i) {
    index_of[board_.markers()[i].id] = i;
  }
  const std::vector<slam::MarkerDetection>& detections = detector_.detect(image);
  std::vector<Seen> seen;
  for (const slam::MarkerDetection& detection : detections) {
    const auto found = index_of.find(detection.id);
    // Of two prints of one id at most one is on the board, and nobody knows which.
    const auto prints = std::ranges::count(detections, detection.id, &slam::MarkerDetection::id);
    if (found != index_of.end() && prints == 1) seen.push_back({found->second, detection});
  }
  return seen;
}

bool BoardDetector::agree(const Seen& a, const Seen& b) const {
  const auto H = slam::homographyFromUnitSquare(a.detection.pixels);
  if (!H) return false;
  const Eigen::Vector2d at =
      inMarker(board_.markers()[a.marker], centreOf(board_.markers()[b.marker]));
  const auto& pixels = b.detection.pixels;
  const double side_px = (pixels[2] - pixels[0]).norm() / std::sqrt(2.0);
  return (slam::applyHomography(*H, at) - centreOf(pixels)).norm() < 0.7 * side_px;
}

// A false detection, or a marker of something else, agrees with none of those that should be next
// to it.
void BoardDetector::removeStrays(std::vector<Seen>* seen) const {
  constexpr std::size_t kNearest = 4;
  std::vector<Seen> kept;
  for (const Seen& one : *seen) {
    const Eigen::Vector3d centre = centreOf(board_.markers()[one.marker]);
    std::vector<std::pair<double, const Seen*>> others;
    for (const Seen& other : *seen) {
      if (&other == &one) continue;
      others.emplace_back((centreOf(board_.markers()[other.marker]) - centre).norm(), &other);
    }
    const std::size_t near = std::min(kNearest, others.size());
    std::partial_sort(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(near),
                      others.end());
    const bool confirmed =
        std::any_of(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(near),
                    [&](const auto& other) { return agree(one, *other.second); });
    if (confirmed) kept.push_back(one);
  }
  *seen = std::move(kept);
}

std::vector<BoardPoint> BoardDetector::markerPoints(const std::vector<Seen>& seen) const {
  std::vector<BoardPoint> points;
  for (const Seen& marker : seen) {
    for (std::size_t k = 0; k < 4; ++k) {
      Eigen::Matrix2d J;
      (void)camera_.distort(marker.detection.normalized[k], &J);
      points.push_back({4 * marker.marker + k, marker.detection.pixels[k],
                        J * marker.detection.covariance[k] * J.transpose()});
    }
  }
  return points;
}

std::optional<BoardPoint> BoardDetector::chessPoint(std::size_t index, const Seen& a, const Seen& b,
                                                    const ImageView& image) const {
  std::array<Eigen::Vector2d, 8> on_board;
  std::array<Eigen::Vector2d, 8> pixels;
  for (std::size_t k = 0; k < 4; ++k) {
    on_board[k] = board_.markers()[a.marker].corners[k].head<2>();
    on_board[4 + k] = board_.markers()[b.marker].corners[k].head<2>();
    pixels[k] = a.detection.pixels[k];
    pixels[4 + k] = b.detection.pixels[k];
  }
  const auto H = fitHomography(on_board, pixels);
  if (!H) return std::nullopt;
  const Eigen::Vector2d point = board_.points()[index].head<2>();
  const Eigen::Vector2d expected = slam::applyHomography(*H, point);
  const auto beside = [&](double x, double y) -> Eigen::Vector2d {
    const Eigen::Vector2d step = board_.clearance_m() * Eigen::Vector2d(x, y);
    return slam::applyHomography(*H, point + step) - expected;
  };
  // Markers begin at (1, 1) of these axes and at its mirror images, sqrt(2) away.
  const Eigen::Vector2d right = beside(1.0, 0.0);
  const Eigen::Vector2d up = beside(0.0, 1.0);
  const double shorter_px = std::min(right.norm(), up.norm());
  const double longer_px = std::max(right.norm(), up.norm());
  const double scale =
      std::min(options_.reach * std::numbers::sqrt2 - options_.reach_margin_px / shorter_px,
               options_.max_reach_px / longer_px);
  if (!(scale * shorter_px >= options_.min_reach_px)) return std::nullopt;
  const auto saddle = fitSaddle(image, expected, scale * right, scale * up, options_.saddles);
  if (!saddle) return std::nullopt;
  return BoardPoint{index, saddle->pixel, saddle->covariance};
}

std::vector<BoardPoint> BoardDetector::chessPoints(const std::vector<Seen>& seen,
                                                   const ImageView& image) const {
  std::vector<const Seen*> by_marker(board_.markers().size(), nullptr);
  for (const Seen& one : seen) by_marker[one.marker] = &one;
  std::vector<BoardPoint> points;
  for (std::size_t i = 0; i < board_.neighbours().size(); ++i) {
    const auto& [first, second] = board_.neighbours()[i];
    if (by_marker[first] == nullptr || by_marker[second] == nullptr) continue;
    const auto point = chessPoint(i, *by_marker[first], *by_marker[second], image);
    if (point) points.push_back(*point);
  }
  return points;
}

std::optional<BoardView> BoardDetector::detect(const ImageView& image) {
  if (board_.chessColumns() > 0) {
    BoardView chess = findChessCorners(image, board_.chessColumns(), board_.chessRows(), options_);
    if (chess.points.size() < options_.min_points) return std::nullopt;
    return chess;
  }
  std::vector<Seen> seen = seenMarkers(image);
  removeStrays(&seen);
  BoardView board_view;
  board_view.blur_px = medianBlur_px(detector_.measured());
  board_view.points = board_.isCharuco() ? chessPoints(seen, image) : markerPoints(seen);
  if (board_view.points.size() < options_.min_points) return std::nullopt;
  return board_view;
}

}  // namespace waymark::calibration
