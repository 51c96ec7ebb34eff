#include "slam/detection/quads/quad_scanner.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Pixels by which an outline goes against its way, 0 where it is convex: the left side goes out
// until it is leftmost and then back in, the right side too. Steps of one pixel are noise.
int stepsBack(const DarkRegion& region) {
  int px = 0;
  bool left_goes_in = false;
  bool right_goes_in = false;
  for (std::size_t i = 1; i < region.rows.size(); ++i) {
    const Extent& above = region.rows[i - 1];
    const Extent& row = region.rows[i];
    left_goes_in |= above.left == region.left;
    right_goes_in |= above.right == region.right;
    const int left_in = row.left - above.left;
    const int right_in = above.right - row.right;
    px += std::max((left_goes_in ? -left_in : left_in) - 1, 0);
    px += std::max((right_goes_in ? -right_in : right_in) - 1, 0);
  }
  return px;
}

}  // namespace

std::string QuadScannerOptions::invalidReason() const {
  return firstReason({
      strict.invalidReason(),
      lenient.invalidReason(),
      regions.invalidReason(),
      quads.invalidReason(),
      firstUnmet({{isPositive(same_corner_px), "the distance of same corners must be positive"}}),
  });
}

QuadScanner::QuadScanner(const QuadScannerOptions& options, const ScanBudgetOptions& budget)
    : masks_(std::array{options.strict, options.lenient}),
      finder_(options.regions),
      fitter_(options.quads),
      known_(options.same_corner_px),
      budget_(budget),
      picker_(budget.turn_share) {}

QuadScan QuadScanner::scan(const ImageView& image, int max_px, const ScanBudget& budget,
                           std::uint32_t turn) {
  QuadScan scan;
  quads_.clear();
  promise_.clear();
  known_.clear();
  const std::span<const DarkMask> masks = masks_.make(image);
  for (const DarkMask& mask : masks) scan.runs += mask.countRuns();
  scan.too_busy = scan.runs > budget.runs;
  if (scan.too_busy) return scan;
  auto masks_left = static_cast<int>(masks.size());
  for (const DarkMask& mask : masks) {
    // What one mask leaves is the next one's.
    collect(finder_.find(mask, max_px), (budget.regions - scan.regions) / masks_left--, turn,
            &scan);
  }
  scan.quads = quads_;
  scan.promise = promise_;
  scan.compared = known_.compared();
  return scan;
}

void QuadScanner::collect(std::span<const DarkRegion> regions, int most, std::uint32_t turn,
                          QuadScan* scan) {
  const auto count = static_cast<int>(regions.size());
  if (count <= most) {
    for (const DarkRegion& region : regions) fit(region);
    scan->regions += count;
    return;
  }
  region_promise_.clear();
  for (const DarkRegion& region : regions) region_promise_.push_back(promiseOf(region));
  const std::span<const std::uint32_t> picked = picker_.pick(region_promise_, most, turn);
  for (const std::uint32_t i : picked) fit(regions[i]);
  scan->regions += static_cast<int>(picked.size());
  scan->deferred_regions += count - static_cast<int>(picked.size());
}

void QuadScanner::fit(const DarkRegion& region) {
  const auto quad = fitter_.fit(region);
  if (!quad || known_.contains(*quad)) return;
  known_.add(*quad);
  quads_.push_back(*quad);
  promise_.push_back(promiseOf(region));
}

// Markers have light cells within and straight sides, and the larger the better they can be read.
float QuadScanner::promiseOf(const DarkRegion& region) const {
  int px = 0;
  for (const Extent& row : region.rows) px += row.right - row.left + 1;
  const double light = static_cast<double>(px - region.dark_px) / px;
  const int extent_px = std::min(region.right - region.left, region.bottom - region.top) + 1;
  const double roughness = stepsBack(region) / static_cast<double>(region.rows.size());
  return static_cast<float>(std::min(light / budget_.promising_light, 1.0) *
                            std::min(extent_px / budget_.promising_px, 1.0) *
                            std::max(1.0 - roughness / budget_.hopeless_roughness, 0.0));
}

}  // namespace waymark::slam
