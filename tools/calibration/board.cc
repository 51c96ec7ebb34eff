#include "tools/calibration/board.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <utility>

#include <Eigen/LU>
#include <Eigen/SVD>

#include "slam/detection/codes/dictionary.h"
#include "slam/detection/marker_detection.h"

namespace waymark::calibration {
namespace {

constexpr int kMaxSquares = 200;  // in a row or a column
constexpr double kLargest_m = 100.0;

// Whether there is a marker at a place of the grid.
bool hasMarker(const BoardOptions& options, int row, int column) {
  if (options.kind == BoardKind::kChessboard) return false;
  return options.kind == BoardKind::kMarkers || (row + column) % 2 != 0;
}

// The centre of a square.
Eigen::Vector3d centreOf(const BoardOptions& options, int row, int column) {
  return {options.square_size_m * (column + 0.5 - 0.5 * options.columns),
          options.square_size_m * (0.5 * options.rows - row - 0.5), 0.0};
}

}  // namespace

int BoardOptions::markerCount() const {
  const int places = columns * rows;
  if (kind == BoardKind::kChessboard) return 0;
  return kind == BoardKind::kCharuco ? places / 2 : places;
}

std::string BoardOptions::invalidReason() const {
  const bool chessboard = kind == BoardKind::kChessboard;
  const int fewest = chessboard ? 4 : (kind == BoardKind::kCharuco ? 3 : 1);
  const std::string range =
      "must be " + std::to_string(fewest) + " to " + std::to_string(kMaxSquares);
  if (columns < fewest || columns > kMaxSquares) return "columns: " + range;
  if (rows < fewest || rows > kMaxSquares) return "rows: " + range;
  if (!chessboard && markerCount() < 2) return "a board has at least two markers";
  if (!(square_size_m > 0.0 && square_size_m <= kLargest_m)) {
    return "square size: must be a positive number of metres, at most 100";
  }
  if (chessboard) return {};
  if (!(marker_size_m > 0.0 && marker_size_m < square_size_m)) {
    return "marker size: must be positive and smaller than the square size";
  }
  const auto known = slam::Dictionary::byName(dictionary);
  if (!known) return "dictionary: '" + dictionary + "' is unknown";
  if (first_id < 0 || first_id + markerCount() > known->size()) {
    return dictionary + " has ids 0 to " + std::to_string(known->size() - 1) +
           ", the board needs " + std::to_string(markerCount()) + " from " +
           std::to_string(first_id) + " on";
  }
  return {};
}

std::string describeBoard(const BoardOptions& o) {
  char text[160];
  if (o.kind == BoardKind::kChessboard) {
    std::snprintf(text, sizeof text, "Chessboard %dx%d, squares %.6g mm", o.columns, o.rows,
                  1000.0 * o.square_size_m);
    return text;
  }
  const bool charuco = o.kind == BoardKind::kCharuco;
  std::snprintf(text, sizeof text, "%s %dx%d, %s %.6g mm, markers %.6g mm, %s from id %d",
                charuco ? "ChArUco" : "Markers", o.columns, o.rows, charuco ? "squares" : "spacing",
                1000.0 * o.square_size_m, 1000.0 * o.marker_size_m, o.dictionary.c_str(),
                o.first_id);
  return text;
}

Board::Board(const BoardOptions& options) : dictionary_(options.dictionary) {
  std::map<std::pair<int, int>, std::size_t> at;  // marker by row, column
  for (int row = 0; row < options.rows; ++row) {
    for (int column = 0; column < options.columns; ++column) {
      if (!hasMarker(options, row, column)) continue;
      at[{row, column}] = markers_.size();
      BoardMarker marker{options.first_id + static_cast<int>(markers_.size()),
                         slam::markerCorners(options.marker_size_m)};
      for (Eigen::Vector3d& corner : marker.corners) corner += centreOf(options, row, column);
      markers_.push_back(marker);
    }
  }
  if (options.kind == BoardKind::kMarkers) {
    takeMarkerCorners();
    return;
  }
  if (options.kind == BoardKind::kChessboard) {
    dictionary_ = BoardOptions{}.dictionary;  // any: nothing of it is looked at
    chess_columns_ = options.columns;
    chess_rows_ = options.rows;
  }
  clearance_m_ = 0.5 * (options.square_size_m - options.marker_size_m);
  for (int row = 1; row < options.rows; ++row) {
    for (int column = 1; column < options.columns; ++column) {
      points_.emplace_back(
          0.5 * (centreOf(options, row - 1, column - 1) + centreOf(options, row, column)));
      if (options.kind == BoardKind::kChessboard) continue;
      // Of the four squares that meet here, two on a diagonal are white.
      const bool falling = hasMarker(options, row, column);
      neighbours_.push_back({at.at({row - 1, falling ? column - 1 : column}),
                             at.at({row, falling ? column : column - 1})});
    }
  }
}

void Board::takeMarkerCorners() {
  for (const BoardMarker& marker : markers_) {
    points_.insert(points_.end(), marker.corners.begin(), marker.corners.end());
  }
}

Result<Board> Board::fromLayout(std::string dictionary, std::vector<BoardMarker> markers) {
  constexpr double kFlatness = 0.01;  // of the extent
  if (markers.size() < 2) return Error{"a board has at least two markers"};
  Board board;
  board.dictionary_ = std::move(dictionary);
  board.markers_ = std::move(markers);
  board.takeMarkerCorners();
  const auto count = static_cast<Eigen::Index>(board.points_.size());
  Eigen::Matrix3Xd points(3, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    points.col(i) = board.points_[static_cast<std::size_t>(i)];
  }
  const Eigen::Vector3d centre = points.rowwise().mean();
  points.colwise() -= centre;
  const Eigen::JacobiSVD<Eigen::Matrix3Xd> svd(points, Eigen::ComputeFullU);
  Eigen::Matrix3d R = svd.matrixU().transpose();
  if (R.determinant() < 0.0) R.row(2) = -R.row(2);
  const Eigen::Matrix3Xd turned = R * points;
  if (turned.row(2).cwiseAbs().maxCoeff() > kFlatness * turned.row(0).cwiseAbs().maxCoeff()) {
    return Error{"its markers do not lie in a plane"};
  }
  for (BoardMarker& marker : board.markers_) {
    for (Eigen::Vector3d& corner : marker.corners) corner = R * (corner - centre);
  }
  board.points_.clear();
  board.takeMarkerCorners();
  return board;
}

}  // namespace waymark::calibration
