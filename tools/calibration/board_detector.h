// Finds a board in an image: its markers say what is what, and its corners are measured.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "base/image_view.h"
#include "slam/detection/marker_detector.h"
#include "slam/geometry/camera_model.h"
#include "tools/calibration/board.h"
#include "tools/calibration/saddle_fit.h"

namespace waymark::calibration {

// A point of the board where an image shows it.
struct BoardPoint {
  std::size_t index = 0;                                     // of Board::points()
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();           // distorted
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Identity();  // square pixels
};

struct BoardView {
  std::vector<BoardPoint> points;
  double blur_px = 0.0;  // of the markers' edges, median of their standard deviations
};

struct BoardDetectorOptions {
  slam::DetectorOptions markers;
  // Fewer points do not fix a pose well enough to say anything of the camera.
  std::size_t min_points = 12;
  SaddleFitOptions saddles;
  // The pixels around a chessboard corner that are used end short of the nearest markers, by this
  // share of their distance and by what blur adds, pixels.
  double reach = 0.85;
  double reach_margin_px = 0.7;
  double min_reach_px = 1.8;  // across; a corner with less room is left out
  double max_reach_px = 8.0;  // more only costs time, and lenses bend lines
};

class BoardDetector {
 public:
  // `camera` need not be right: a guess costs accuracy only where the lens bends the sides of a
  // marker. The board must outlive the detector.
  BoardDetector(const Board& board, const slam::Calibration& camera,
                const BoardDetectorOptions& options = {});

  // Empty when too little of the board is there.
  [[nodiscard]] std::optional<BoardView> detect(const ImageView& image);

 private:
  // A marker of the board, as it was seen.
  struct Seen {
    std::size_t marker = 0;  // index on the board
    slam::MarkerDetection detection;
  };

  [[nodiscard]] std::vector<Seen> seenMarkers(const ImageView& image);
  // Whether the one says where the other is.
  [[nodiscard]] bool agree(const Seen& a, const Seen& b) const;
  void removeStrays(std::vector<Seen>* seen) const;
  [[nodiscard]] std::vector<BoardPoint> markerPoints(const std::vector<Seen>& seen) const;
  [[nodiscard]] std::vector<BoardPoint> chessPoints(const std::vector<Seen>& seen,
                                                    const ImageView& image) const;
  [[nodiscard]] std::optional<BoardPoint> chessPoint(std::size_t index, const Seen& a,
                                                     const Seen& b, const ImageView& image) const;

  const Board& board_;
  slam::CameraModel camera_;
  slam::MarkerDetector detector_;
  BoardDetectorOptions options_;
};

// What to begin with where nothing is known of a camera: no distortion, 53 degrees wide.
[[nodiscard]] slam::Calibration roughCalibration(int width, int height);

}  // namespace waymark::calibration
