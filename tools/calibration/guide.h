// What is to be done next with a board in front of a camera, while its views are collected.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "slam/geometry/camera_model.h"
#include "tools/calibration/board.h"
#include "tools/calibration/board_detector.h"
#include "tools/calibration/view_collector.h"

namespace waymark::calibration {

struct GuideOptions {
  // Views that determine a lens well in every picture that has been tried; fewer may do.
  std::size_t good_views = 15;
  // Of the board against the image, to each of two sides and their opposites: 20 degrees by a
  // camera that is only guessed. The calibrator's least is 14, and 30 are good.
  double good_tilt_rad = 0.35;
  // Frames without the board, until it is missed.
  int patience_frames = 10;
};

struct Advice {
  std::string text;     // for people, one line
  bool enough = false;  // nothing more is needed
};

class Guide {
 public:
  // The board must outlive it. width, height: of the frames, pixels.
  Guide(const Board& board, int width, int height, const GuideOptions& options = {});

  // What a frame showed of the board; null: nothing.
  void add(const BoardView* board_view);
  [[nodiscard]] Advice advice(const ViewCollector& collected) const;

 private:
  enum Side : std::size_t { kLeft, kRight, kTop, kBottom, kSides };

  // Towards which sides the views have not been tilted yet, in words.
  [[nodiscard]] std::string missingTilts() const;

  const Board& board_;
  const slam::CameraModel camera_;
  const GuideOptions options_;
  std::array<double, kSides> tilt_rad_{};  // the largest: this side of the board farther away
  int frames_without_ = 0;                 // in a row
  std::optional<double> blur_px_;          // of the newest view
};

}  // namespace waymark::calibration
