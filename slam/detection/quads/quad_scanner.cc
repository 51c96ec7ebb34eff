#include "slam/detection/quads/quad_scanner.h"

#include <algorithm>
#include <array>

#include "slam/option_checks.h"

namespace waymark::slam {

std::string QuadScannerOptions::invalidReason() const {
  return firstReason({
      strict.invalidReason(),
      lenient.invalidReason(),
      regions.invalidReason(),
      quads.invalidReason(),
      firstUnmet({{isPositive(same_corner_px), "the distance of same corners must be positive"}}),
  });
}

QuadScanner::QuadScanner(const QuadScannerOptions& options)
    : masks_(std::array{options.strict, options.lenient}),
      finder_(options.regions),
      fitter_(options.quads),
      same_corner_px_(options.same_corner_px) {}

const std::vector<Quad>& QuadScanner::scan(const ImageView& image, int max_px) {
  quads_.clear();
  for (const DarkMask& mask : masks_.make(image)) collect(mask, max_px);
  return quads_;
}

void QuadScanner::collect(const DarkMask& mask, int max_px) {
  for (const DarkRegion& region : finder_.find(mask, max_px)) {
    const auto quad = fitter_.fit(region);
    if (quad && !isKnown(*quad)) quads_.push_back(*quad);
  }
}

bool QuadScanner::isKnown(const Quad& quad) const {
  return std::ranges::any_of(quads_, [&](const Quad& known) {
    return std::ranges::all_of(quad, [&](const Eigen::Vector2d& corner) {
      return std::ranges::any_of(known, [&](const Eigen::Vector2d& other) {
        return (corner - other).squaredNorm() < same_corner_px_ * same_corner_px_;
      });
    });
  });
}

}  // namespace waymark::slam
