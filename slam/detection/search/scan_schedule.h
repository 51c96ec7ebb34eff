// Which part of the image is searched in which frame, so that what nobody expects is found soon and
// no frame pays for all of the image.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "slam/detection/search/window.h"

namespace waymark::slam {

struct ScanScheduleOptions {
  // A marker that appears is found within this time, seconds; one that is only a few times the
  // smallest that can be found may take small_rounds times as long. Shorter costs more a frame.
  double round_s = 0.1;
  // Rounds that the parts of the image at its full size, for small markers, are spread over: most
  // of the pixels are theirs.
  int small_rounds = 4;
  // A round has no more frames than this, however fast they come, and this many where nobody knows.
  int max_frames = 64;
  // Parts overlap by this many pixels at the size they are searched at: a marker up to that size is
  // whole in one of them, and a larger one is found at half that size.
  int overlap_px = 40;
  // No further halving below this height, pixels.
  int min_height_px = 120;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

class ScanSchedule {
 public:
  ScanSchedule(int width, int height, const ScanScheduleOptions& options = {});

  // The parts whose turn it is, as evenly as may be from frame to frame. interval_s: since the
  // frame before. least_frames: each reduced size is spread over so many frames at least, and the
  // full one over twice as many. Valid until the next call.
  std::span<const SearchRegion> next(double interval_s, int least_frames = 1);
  // The largest factor.
  [[nodiscard]] int coarsest() const { return levels_.front().factor; }

 private:
  // The image at one size, in parts of a grid that have their turns one after the other.
  struct Level {
    int factor = 1;
    int columns = 1;
    int rows = 1;
    int frames = 1;            // that a round of them takes
    int part = 0;              // whose turn is next
    std::uint32_t rounds = 0;  // so many turns has each part before it had
    int credit = 0;            // parts times frames since the last turn: one is due at `frames`
    double px_per_frame = 0.0;
  };

  void beginRound(double interval_s, int least_frames);
  void divide(Level* level, int frames) const;
  [[nodiscard]] SearchRegion partOf(const Level& level) const;

  ScanScheduleOptions options_;
  int width_;
  int height_;
  int frames_ = 1;             // a round has
  int frame_ = 0;              // within the round
  double unspent_px_ = 0.0;    // of what frames have to spend on turns
  std::vector<Level> levels_;  // coarse before fine
  std::vector<SearchRegion> due_;
};

}  // namespace waymark::slam
