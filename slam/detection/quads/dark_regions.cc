#include "slam/detection/quads/dark_regions.h"

#include <algorithm>
#include <bit>
#include <limits>

#include "slam/option_checks.h"

namespace waymark::slam {

std::string DarkRegionOptions::invalidReason() const {
  return firstUnmet({
      {min_extent_px >= 1, "the least extent of a region must be at least 1 pixel"},
      {border_margin_px >= 0, "the margin along the image's border must not be negative"},
  });
}

std::span<const DarkRegion> DarkRegionFinder::find(const DarkMask& mask, int max_px) {
  collectRuns(mask);
  joinRuns();
  measureBoxes();
  collectRegions(mask, max_px);
  return regions_;
}

void DarkRegionFinder::collectRuns(const DarkMask& mask) {
  runs_.clear();
  first_run_.clear();
  for (int y = 0; y < mask.height(); ++y) {
    first_run_.push_back(static_cast<std::int32_t>(runs_.size()));
    const std::uint64_t* const row = mask.row(y);
    std::uint64_t last_bit = 0;
    bool within = false;
    const auto turnAt = [&](int x) {
      if (within) {
        runs_.back().extent.right = static_cast<std::int16_t>(x - 1);
      } else {
        const auto index = static_cast<std::int32_t>(runs_.size());
        runs_.push_back({{static_cast<std::int16_t>(x), 0}, index, -1});
      }
      within = !within;
    };
    for (int w = 0; w < mask.wordsPerRow(); ++w) {
      std::uint64_t turns = row[w] ^ (row[w] << 1U | last_bit);
      last_bit = row[w] >> 63U;
      for (; turns != 0; turns &= turns - 1) turnAt(64 * w + std::countr_zero(turns));
    }
    if (within) turnAt(mask.width());
  }
  first_run_.push_back(static_cast<std::int32_t>(runs_.size()));
}

std::int32_t DarkRegionFinder::rootOf(std::int32_t run) {
  auto* const runs = runs_.data();
  while (runs[run].parent != run) {
    runs[run].parent = runs[runs[run].parent].parent;
    run = runs[run].parent;
  }
  return run;
}

void DarkRegionFinder::joinRuns() {
  for (std::size_t y = 1; y + 1 < first_run_.size(); ++y) {
    std::int32_t above = first_run_[y - 1];
    std::int32_t here = first_run_[y];
    const std::int32_t above_end = first_run_[y];
    const std::int32_t here_end = first_run_[y + 1];
    while (above < above_end && here < here_end) {
      const Extent a = runs_[static_cast<std::size_t>(above)].extent;
      const Extent b = runs_[static_cast<std::size_t>(here)].extent;
      if (a.left <= b.right && b.left <= a.right) {
        const std::int32_t p = rootOf(above);
        const std::int32_t q = rootOf(here);
        runs_[static_cast<std::size_t>(std::max(p, q))].parent = std::min(p, q);
      }
      ++(a.right < b.right ? above : here);
    }
  }
}

void DarkRegionFinder::measureBoxes() {
  boxes_.clear();
  for (std::size_t y = 0; y + 1 < first_run_.size(); ++y) {
    for (std::int32_t i = first_run_[y]; i < first_run_[y + 1]; ++i) {
      Run& run = runs_[static_cast<std::size_t>(i)];
      const int left = run.extent.left;
      const int right = run.extent.right;
      const int row = static_cast<int>(y);
      const std::int32_t root = rootOf(i);
      run.parent = root;
      if (root == i) {
        run.region = static_cast<std::int32_t>(boxes_.size());
        boxes_.push_back({left, right, row, row, right - left + 1, -1});
        continue;
      }
      run.region = runs_[static_cast<std::size_t>(root)].region;
      Box& box = boxes_[static_cast<std::size_t>(run.region)];
      box.left = std::min(box.left, left);
      box.right = std::max(box.right, right);
      box.bottom = row;
      box.dark_px += right - left + 1;
    }
  }
}

bool DarkRegionFinder::mayBeMarker(const Box& box, const DarkMask& mask, int max_px) const {
  const int margin = options_.border_margin_px;
  const int across = box.right - box.left + 1;
  const int down = box.bottom - box.top + 1;
  return std::min(across, down) >= options_.min_extent_px &&
         (max_px == 0 || std::max(across, down) <= max_px) && box.left >= margin &&
         box.top >= margin && box.right < mask.width() - margin &&
         box.bottom < mask.height() - margin;
}

void DarkRegionFinder::collectRegions(const DarkMask& mask, int max_px) {
  constexpr Extent kNone{std::numeric_limits<std::int16_t>::max(), -1};
  rows_.clear();
  for (Box& box : boxes_) {
    if (!mayBeMarker(box, mask, max_px)) continue;
    box.first_row = static_cast<int>(rows_.size());
    const int count = box.bottom - box.top + 1;
    rows_.resize(rows_.size() + static_cast<std::size_t>(count), kNone);
  }
  for (std::size_t y = 0; y + 1 < first_run_.size(); ++y) {
    for (std::int32_t i = first_run_[y]; i < first_run_[y + 1]; ++i) {
      const Run& run = runs_[static_cast<std::size_t>(i)];
      const Box& box = boxes_[static_cast<std::size_t>(run.region)];
      if (box.first_row < 0) continue;
      const int index = box.first_row + static_cast<int>(y) - box.top;
      Extent& row = rows_[static_cast<std::size_t>(index)];
      row.left = std::min(row.left, run.extent.left);
      row.right = std::max(row.right, run.extent.right);
    }
  }
  regions_.clear();
  for (const Box& box : boxes_) {
    if (box.first_row < 0) continue;
    const auto count = static_cast<std::size_t>(box.bottom - box.top + 1);
    regions_.push_back({box.left,
                        box.right,
                        box.top,
                        box.bottom,
                        box.dark_px,
                        {rows_.data() + box.first_row, count}});
  }
}

}  // namespace waymark::slam
