#include "slam/detection/scan_turns.h"

#include <algorithm>
#include <cmath>

namespace waymark::slam {

ScanTurns::ScanTurns(int width, int height, const ScanTurnsOptions& options)
    : options_(options), width_(width), height_(height) {
  int factor = 1;
  while (height / (2 * factor) >= options.least_height_px) factor *= 2;
  // Not all of them in the same frame.
  for (; factor >= 1; factor /= 2) levels_.push_back({.factor = factor, .credit = factor});
  constexpr std::size_t kStrips = 4;  // of two sizes along two borders
  due_.reserve(levels_.size() + kStrips);
}

std::span<const ScanTurn> ScanTurns::next(double interval_s, const Eigen::Vector2d& flow_px) {
  due_.clear();
  if (frame_ == 0) {
    constexpr int kMostFrames = 64;
    const double frames = interval_s > 0.0 ? options_.round_s / interval_s : kMostFrames;
    frames_ = static_cast<int>(std::clamp(frames, 1.0, double{kMostFrames}));
    for (Level& level : levels_) {
      divide(&level, level.factor == 1 ? kSmallRounds * frames_ : frames_);
    }
  }
  if (frames_ == 1) {
    due_.push_back({{0, 0, width_, height_}, 1});
    return due_;
  }
  addStrips(flow_px);
  for (Level& level : levels_) {
    // Evenly over the frames of its round.
    const int parts = level.columns * level.rows;
    const int frames = level.factor == 1 ? kSmallRounds * frames_ : frames_;
    level.credit += parts;
    if (level.credit < frames) continue;
    level.credit -= frames;
    due_.push_back(partOf(level));
    level.part = (level.part + 1) % parts;
  }
  frame_ = (frame_ + 1) % frames_;
  return due_;
}

// What has come into view lies along the border that the scene comes over. Large markers take
// longer to, so every other frame will do for them.
void ScanTurns::addStrips(const Eigen::Vector2d& flow_px) {
  constexpr double kStill = 0.5;  // pixels a frame: its turn comes before much has come into view
  for (const int factor : {4, 2, 1}) {
    const bool due = factor == 1 || (factor == 2) == (frame_ % 2 == 0);
    if (!due || factor > levels_.front().factor) continue;
    const int across = factor * options_.overlap_px;
    if (std::abs(flow_px.x()) > kStill && across < width_) {
      due_.push_back({{flow_px.x() > 0.0 ? 0 : width_ - across, 0, across, height_}, factor});
    }
    if (std::abs(flow_px.y()) > kStill && across < height_) {
      due_.push_back({{0, flow_px.y() > 0.0 ? 0 : height_ - across, width_, across}, factor});
    }
  }
}

// About as many parts, never more, as near to squares as they get; but not so small that they are
// mostly overlap.
void ScanTurns::divide(Level* level, int parts) const {
  const double aspect = static_cast<double>(width_) / height_;
  const int least = 3 * options_.overlap_px * level->factor;
  const int rows = std::clamp(static_cast<int>(std::lround(std::sqrt(parts / aspect))), 1, parts);
  level->rows = std::clamp(height_ / least, 1, rows);
  level->columns = std::clamp(width_ / least, 1, parts / rows);
  level->part %= level->columns * level->rows;
}

ScanTurn ScanTurns::partOf(const Level& level) const {
  const int column = level.part % level.columns;
  const int row = level.part / level.columns;
  const int overlap = options_.overlap_px * level.factor;
  Window window;
  window.left = column * width_ / level.columns;
  window.top = row * height_ / level.rows;
  window.width = std::min((column + 1) * width_ / level.columns + overlap, width_) - window.left;
  window.height = std::min((row + 1) * height_ / level.rows + overlap, height_) - window.top;
  return {window, level.factor};
}

}  // namespace waymark::slam
