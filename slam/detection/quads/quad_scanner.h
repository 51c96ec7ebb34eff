// Full-frame search for dark, convex quadrilaterals: the first, rough stage of detection.
#pragma once

#include <string>
#include <vector>

#include "base/image_view.h"
#include "slam/detection/quads/dark_mask.h"
#include "slam/detection/quads/dark_regions.h"
#include "slam/detection/quads/region_quad.h"

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

class QuadScanner {
 public:
  explicit QuadScanner(const QuadScannerOptions& options = {});

  // Those wider or higher than max_px are left out, where that is not 0. Valid until the next
  // call.
  const std::vector<Quad>& scan(const ImageView& image, int max_px = 0);

 private:
  void collect(const DarkMask& mask, int max_px);
  [[nodiscard]] bool isKnown(const Quad& quad) const;

  DarkMaskMaker masks_;
  DarkRegionFinder finder_;
  RegionQuadFitter fitter_;
  double same_corner_px_;
  std::vector<Quad> quads_;
};

}  // namespace waymark::slam
