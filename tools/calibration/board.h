// The flat boards that cameras are calibrated with: where their markers and chessboard corners are.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "base/result.h"

namespace waymark::calibration {

enum class BoardKind {
  // A chessboard with a marker in each white square, as OpenCV lays it out (the top-left square is
  // black, ids row by row). Its inner corners are measured, the markers say which they are.
  kCharuco,
  // Markers in a grid, ids row by row. Their corners are measured.
  kMarkers,
  // A plain chessboard, the top-left square black. Its inner corners are measured, where all of it
  // is
  // in view.
  kChessboard,
};

struct BoardOptions {
  BoardKind kind = BoardKind::kCharuco;
  // The defaults fill an A4 page and give 54 corners.
  int columns = 7;               // squares, or markers
  int rows = 10;                 // squares, or markers
  double square_size_m = 0.025;  // side of a square; or from one marker to the next
  double marker_size_m = 0.018;  // side of the markers' black squares
  std::string dictionary = "5X5_100";
  int first_id = 0;

  [[nodiscard]] int markerCount() const;
  // Empty when there can be such a board, else the reason why not: "columns: must be ...".
  [[nodiscard]] std::string invalidReason() const;
};

// "ChArUco 7x10, squares 25 mm, markers 18 mm, 5X5_100 from id 0".
[[nodiscard]] std::string describeBoard(const BoardOptions& options);

// Corners: top-left, top-right, bottom-right, bottom-left of the upright print.
struct BoardMarker {
  int id = -1;
  std::array<Eigen::Vector3d, 4> corners;  // metres, board frame
};

// Board frame: origin at the centre, x right, y up, z out of the print.
class Board {
 public:
  // Precondition: options.invalidReason() is empty.
  explicit Board(const BoardOptions& options);

  // Any flat layout of markers; their frame is turned so that the board lies in z = 0. An Error
  // says why it is no board: fewer than two markers, or not flat to a hundredth of its extent.
  [[nodiscard]] static Result<Board> fromLayout(std::string dictionary,
                                                std::vector<BoardMarker> markers);

  [[nodiscard]] const std::string& dictionary() const { return dictionary_; }
  [[nodiscard]] const std::vector<BoardMarker>& markers() const { return markers_; }

  // What is measured, metres: the chessboard's inner corners row by row, or corner k of marker i at
  // 4 i + k.
  [[nodiscard]] const std::vector<Eigen::Vector3d>& points() const { return points_; }

  // The two markers (indices) whose corners touch a chessboard corner; empty for marker boards.
  [[nodiscard]] const std::vector<std::array<std::size_t, 2>>& neighbours() const {
    return neighbours_;
  }
  // From a chessboard corner to the nearest marker, along x and y, metres.
  [[nodiscard]] double clearance_m() const { return clearance_m_; }

  // Squares of a plain chessboard; else 0.
  [[nodiscard]] int chessColumns() const { return chess_columns_; }
  [[nodiscard]] int chessRows() const { return chess_rows_; }

  [[nodiscard]] bool isCharuco() const { return !neighbours_.empty(); }

 private:
  Board() = default;
  void takeMarkerCorners();

  std::string dictionary_;
  std::vector<BoardMarker> markers_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<std::array<std::size_t, 2>> neighbours_;
  double clearance_m_ = 0.0;
  int chess_columns_ = 0;
  int chess_rows_ = 0;
};

}  // namespace waymark::calibration
