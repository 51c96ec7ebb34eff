#include "slam/detection/search/scan_schedule.h"

#include <algorithm>
#include <cmath>

#include "slam/option_checks.h"

namespace waymark::slam {
std::string ScanScheduleOptions::invalidReason() const {
  return firstUnmet({
      {isPositive(round_s), "the time of a round must be positive"},
      {small_rounds >= 1, "small markers need at least 1 round"},
      {max_frames >= 1, "a round has at least 1 frame"},
      {overlap_px >= 1, "parts must overlap by at least 1 pixel"},
      {min_height_px >= 1, "the least height of a reduced image must be at least 1 pixel"},
  });
}

ScanSchedule::ScanSchedule(int width, int height, const ScanScheduleOptions& options)
    : options_(options), width_(width), height_(height) {
  int factor = 1;
  while (height / (2 * factor) >= options.min_height_px) factor *= 2;
  // Not all of them in the same frame.
  for (; factor >= 1; factor /= 2) levels_.push_back({.factor = factor, .credit = factor});
  due_.reserve(levels_.size());
}

// Parts of reduced images when it is their turn. Every frame has as many pixels to spend as all of
// them need on average: where those took more, the small markers' parts wait.
std::span<const SearchRegion> ScanSchedule::next(double interval_s, int least_frames) {
  due_.clear();
  if (frame_ == 0) beginRound(interval_s, least_frames);
  if (frames_ == 1) {
    due_.push_back({{0, 0, width_, height_}, 1, 0, levels_.back().rounds++});
    return due_;
  }
  for (const Level& level : levels_) unspent_px_ += level.px_per_frame;
  for (Level& level : levels_) {
    const int parts = level.columns * level.rows;
    level.credit += parts;
    if (level.credit < level.frames || (level.factor == 1 && unspent_px_ <= 0.0)) continue;
    level.credit -= level.frames;
    due_.push_back(partOf(level));
    unspent_px_ -= searchedPixels(due_.back());
    level.part = (level.part + 1) % parts;
    if (level.part == 0) ++level.rounds;
  }
  frame_ = (frame_ + 1) % frames_;
  return due_;
}

void ScanSchedule::beginRound(double interval_s, int least_frames) {
  const auto most = static_cast<double>(std::max(options_.max_frames, least_frames));
  const double frames = interval_s > 0.0 ? options_.round_s / interval_s : most;
  const double least = least_frames > 1 ? 2.0 : 1.0;  // in one, it is not searched in parts
  frames_ = static_cast<int>(std::clamp(frames, least, most));
  for (Level& level : levels_) {
    divide(&level, level.factor == 1 ? std::max(options_.small_rounds * frames_, 2 * least_frames)
                                     : std::max(frames_, least_frames));
  }
}

// Into about as many parts as there are frames, never more, as near to squares as they get; but not
// so small that they are mostly overlap.
void ScanSchedule::divide(Level* level, int frames) const {
  const double aspect = static_cast<double>(width_) / height_;
  const int least = 3 * options_.overlap_px * level->factor;
  const int rows = std::clamp(static_cast<int>(std::lround(std::sqrt(frames / aspect))), 1, frames);
  level->rows = std::clamp(height_ / least, 1, rows);
  level->columns = std::clamp(width_ / least, 1, frames / rows);
  level->frames = frames;
  const int parts = level->columns * level->rows;
  level->part %= parts;
  level->px_per_frame = searchedPixels(partOf(*level)) * parts / frames;
}

SearchRegion ScanSchedule::partOf(const Level& level) const {
  const int column = level.part % level.columns;
  const int row = level.part / level.columns;
  const int overlap = options_.overlap_px * level.factor;
  Window window;
  window.left = column * width_ / level.columns;
  window.top = row * height_ / level.rows;
  window.width = std::min((column + 1) * width_ / level.columns + overlap, width_) - window.left;
  window.height = std::min((row + 1) * height_ / level.rows + overlap, height_) - window.top;
  const bool coarsest = level.factor == levels_.front().factor;
  // What is much larger than the overlap is rarely whole here, and soon found at a coarser size.
  return {window, level.factor, coarsest ? 0 : 2 * options_.overlap_px, level.rounds};
}

}  // namespace waymark::slam
