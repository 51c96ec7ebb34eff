// Full-frame search for dark, convex quadrilaterals: the first, rough stage of detection.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/image_view.h"
#include "slam/detection/quads/dark_mask.h"
#include "slam/detection/quads/dark_regions.h"
#include "slam/detection/quads/known_quads.h"
#include "slam/detection/quads/region_quad.h"
#include "slam/detection/scan_budget.h"
#include "slam/detection/turn_picker.h"

namespace waymark::slam {

struct QuadScannerOptions {
  // Strict: keeps squares apart that nearly touch. Lenient: keeps blurred borders whole, between
  // light cells and light paper.
  DarkMaskOptions strict{.share = 0.16, .offset = 8.0};
  DarkMaskOptions lenient{.share = 0.02, .offset = 2.0};
  DarkRegionOptions regions;
  RegionQuadOptions quads;
  // Two quads are the same where each corner of one is this near to one of the other, pixels: both
  // thresholds find most squares.
  double same_corner_px = 1.5;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// The quads of an image, and what was looked at for them.
struct QuadScan {
  std::span<const Quad> quads;
  std::span<const float> promise;  // of each: how much it looks like a marker, from 0 to 1
  bool too_busy = false;           // nothing of it was searched: it has too many runs
  int runs = 0;
  int regions = 0;           // that were fitted
  int deferred_regions = 0;  // that were not
  int compared = 0;          // pairs of quads
};

class QuadScanner {
 public:
  explicit QuadScanner(const QuadScannerOptions& options = {},
                       const ScanBudgetOptions& budget = {});

  // Those wider or higher than max_px are left out, where that is not 0. Of more regions than
  // `budget` allows some have their turn; `turn` counts the searches of this part. Valid until
  // the next call.
  QuadScan scan(const ImageView& image, int max_px = 0, const ScanBudget& budget = {},
                std::uint32_t turn = 0);

 private:
  void collect(std::span<const DarkRegion> regions, int most, std::uint32_t turn, QuadScan* scan);
  void fit(const DarkRegion& region);
  [[nodiscard]] float promiseOf(const DarkRegion& region) const;

  DarkMaskMaker masks_;
  DarkRegionFinder finder_;
  RegionQuadFitter fitter_;
  KnownQuads known_;
  ScanBudgetOptions budget_;
  TurnPicker picker_;
  std::vector<Quad> quads_;
  std::vector<float> promise_;         // of quads_
  std::vector<float> region_promise_;  // reused from mask to mask
};

}  // namespace waymark::slam
