#include "slam/detection/search/border_entry_detector.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <utility>

#include "base/vectorized.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

constexpr int kAround = 16;  // pixels to either side whose mean is what a pixel is dark against

// 1 where a pixel is dark: below so many sixteenths of the mean around it, and the offset below
// that.
WAYMARK_VECTORIZED void flagDark(const std::uint8_t* grey, const std::uint16_t* sums, int length,
                                 int sixteenths, int offset, std::uint8_t* flags) {
  constexpr int kPixels = 2 * kAround;
  for (int i = 0; i < length; ++i) {
    flags[i] = 16 * kPixels * (grey[i] + offset) < sixteenths * sums[i] ? 1 : 0;
  }
}

}  // namespace

std::string BorderEntryOptions::invalidReason() const {
  return firstUnmet({
      {dark_sixteenths >= 1 && dark_sixteenths <= 16,
       "dark pixels must be below 1 to 16 sixteenths of the mean"},
      {dark_offset >= 0, "the offset of dark pixels must not be negative"},
      {min_run_px >= 1, "a run of dark pixels has at least 1"},
      {near_px >= 0, "motion along the border must not be negative"},
  });
}

BorderEntryDetector::BorderEntryDetector(int width, int height, int coarsest, int reach_px,
                                         const BorderEntryOptions& options)
    : width_(width), height_(height), reach_px_(reach_px), options_(options) {
  for (int factor = coarsest; factor >= 1; factor /= 2) {
    for (const Border border : {kLeft, kRight, kTop, kBottom})
      lines_.push_back({border, factor, {}});
  }
}

std::span<const SearchRegion> BorderEntryDetector::next(const ImageView& image) {
  due_.clear();
  for (Line& line : lines_) {
    sample(image, line);
    findRuns(lengthOf(line));
    addWindows(line);
    std::swap(line.runs, runs_);
  }
  return due_;
}

int BorderEntryDetector::lengthOf(const Line& line) const {
  return (isUpright(line.border) ? height_ : width_) / line.factor;
}

// The second row or column from the border at the line's size: a marker's outline is looked for
// from the third one on.
void BorderEntryDetector::sample(const ImageView& image, const Line& line) {
  const int factor = line.factor;
  const int length = lengthOf(line);
  const int from_border = factor + factor / 2;
  grey_.resize(static_cast<std::size_t>(length + 2 * kAround));
  std::uint8_t* const grey = grey_.data() + kAround;
  const auto along = [&](const std::uint8_t* pixel, std::ptrdiff_t step) {
    pixel += factor / 2 * step;
    for (int i = 0; i < length; ++i) grey[i] = pixel[i * factor * step];
  };
  switch (line.border) {
    case kLeft:
      along(image.row(0) + from_border, image.stride);
      break;
    case kRight:
      along(image.row(0) + width_ - 1 - from_border, image.stride);
      break;
    case kTop:
      along(image.row(from_border), 1);
      break;
    case kBottom:
      along(image.row(height_ - 1 - from_border), 1);
      break;
  }
  std::fill_n(grey - kAround, kAround, grey[0]);
  std::fill_n(grey + length, kAround, grey[length - 1]);
}

// Dark against the mean of what lies around on the line.
void BorderEntryDetector::findRuns(int length) {
  const auto n = static_cast<std::size_t>(length);
  sums_.resize(n);
  std::uint16_t sum = 0;
  for (std::size_t i = 0; i < 2 * kAround; ++i) sum = static_cast<std::uint16_t>(sum + grey_[i]);
  for (std::size_t i = 0; i < n; ++i) {
    sums_[i] = sum;
    sum = static_cast<std::uint16_t>(sum + grey_[i + 2 * kAround] - grey_[i]);
  }
  dark_.assign(n + 8, 0);
  flagDark(grey_.data() + kAround, sums_.data(), length, options_.dark_sixteenths,
           options_.dark_offset, dark_.data());
  runs_.clear();
  for (int i = 0; i < length; ++i) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, dark_.data() + i, 8);
    if (eight == 0) {
      i += 7;
      continue;
    }
    if (dark_[static_cast<std::size_t>(i)] == 0) continue;
    const int first = i;
    while (dark_[static_cast<std::size_t>(i)] != 0) ++i;
    if (i - first >= options_.min_run_px) runs_.push_back({first, i - 1});
  }
}

void BorderEntryDetector::addWindows(const Line& line) {
  auto still = runs_.begin();
  SearchRegion* last = nullptr;
  for (const Run& before : line.runs) {
    while (still != runs_.end() && still->last < before.first - options_.near_px) ++still;
    if (still != runs_.end() && still->first <= before.last + options_.near_px) continue;
    const SearchRegion region = windowAt(line, before);
    if (region.window.width == 0 || region.window.height == 0) continue;
    Window* const former = last != nullptr ? &last->window : nullptr;
    // Those that overlap become one.
    if (former != nullptr && region.window.left <= former->left + former->width &&
        region.window.top <= former->top + former->height) {
      former->width = region.window.left + region.window.width - former->left;
      former->height = region.window.top + region.window.height - former->top;
      continue;
    }
    due_.push_back(region);
    last = &due_.back();
  }
}

SearchRegion BorderEntryDetector::windowAt(const Line& line, const Run& gone) const {
  const bool upright = isUpright(line.border);
  const int depth = std::min(line.factor * reach_px_, upright ? width_ : height_);
  const int low = std::max(line.factor * (gone.first - reach_px_), 0);
  const int high = std::min(line.factor * (gone.last + 1 + reach_px_), upright ? height_ : width_);
  const int max_px = line.factor == lines_.front().factor ? 0 : reach_px_;
  switch (line.border) {
    case kLeft:
      return {{0, low, depth, high - low}, line.factor, max_px};
    case kRight:
      return {{width_ - depth, low, depth, high - low}, line.factor, max_px};
    case kTop:
      return {{low, 0, high - low, depth}, line.factor, max_px};
    case kBottom:
      return {{low, height_ - depth, high - low, depth}, line.factor, max_px};
  }
  return {};
}

}  // namespace waymark::slam
