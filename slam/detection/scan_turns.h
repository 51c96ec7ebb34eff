// Which part of the image is searched in which frame, so that what nobody expects is found soon and
// no frame pays for all of the image.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "slam/detection/window.h"

namespace waymark::slam {

struct ScanTurn {
  Window window;   // of the whole image
  int factor = 1;  // searched at 1/factor of its size
};

struct ScanTurnsOptions {
  // A marker that appears is found within this time, seconds; one that is only a few times the
  // smallest that can be found may take kSmallRounds times as long. Shorter costs more a frame.
  double round_s = 0.1;
  // Parts overlap by this many pixels at the size they are searched at: a marker up to that size is
  // whole in one of them, and a larger one is found at half that size.
  int overlap_px = 48;
  // No further halving below this height, pixels.
  int least_height_px = 120;
};

class ScanTurns {
 public:
  static constexpr int kSmallRounds = 4;

  ScanTurns(int width, int height, const ScanTurnsOptions& options = {});

  // The parts that are due, coarse before fine; with them the strips along the borders over which
  // the scene comes into view. interval_s: since the frame before; flow_px: how the scene moved in
  // the image since. Valid until the next call.
  std::span<const ScanTurn> next(double interval_s, const Eigen::Vector2d& flow_px);

 private:
  // The image at one size, in parts of a grid that have their turns one after the other.
  struct Level {
    int factor = 1;
    int columns = 1;
    int rows = 1;
    int part = 0;    // whose turn is next
    int credit = 0;  // parts times frames since the last turn: one is due at the frames of a round
  };

  void divide(Level* level, int parts) const;
  [[nodiscard]] ScanTurn partOf(const Level& level) const;
  void addStrips(const Eigen::Vector2d& flow_px);

  ScanTurnsOptions options_;
  int width_;
  int height_;
  int frames_ = 1;             // a round has
  int frame_ = 0;              // within the round
  std::vector<Level> levels_;  // coarse before fine
  std::vector<ScanTurn> due_;
};

}  // namespace waymark::slam
