// The connected dark regions of a mask that may be markers, and their outlines.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "slam/detection/quads/dark_mask.h"

namespace waymark::slam {

// Pixels from `left` to `right`, both included.
struct Extent {
  std::int16_t left = 0;
  std::int16_t right = 0;
};

struct DarkRegion {
  // Bounding box, pixels, all included.
  int left = 0;
  int right = 0;
  int top = 0;
  int bottom = 0;
  int dark_px = 0;  // without what is light within its outline
  // Row by row from the top, the outermost pixels: of a convex region that is its outline.
  std::span<const Extent> rows;
};

struct DarkRegionOptions {
  // Narrower or lower ones are left out, pixels.
  int min_extent_px = 5;
  // Regions nearer to the image's border are clipped markers at best, pixels.
  int border_margin_px = 2;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

class DarkRegionFinder {
 public:
  explicit DarkRegionFinder(const DarkRegionOptions& options = {}) : options_(options) {}

  // Regions are 4-connected, so that squares touching at their corners, as on a chessboard, stay
  // apart. Those wider or higher than max_px are left out, where that is not 0. From top to
  // bottom; valid until the next call.
  [[nodiscard]] std::span<const DarkRegion> find(const DarkMask& mask, int max_px = 0);

 private:
  // A run of dark pixels in a row; joined to those it touches by their indices (union-find).
  struct Run {
    Extent extent;
    std::int32_t parent;  // an index not above its own; its own at the root
    std::int32_t region;  // of a root: index of its box
  };
  struct Box {
    int left, right, top, bottom;
    int dark_px;
    int first_row;  // in rows_; -1 when the region is left out
  };

  void collectRuns(const DarkMask& mask);
  void joinRuns();
  void measureBoxes();
  void collectRegions(const DarkMask& mask, int max_px);
  [[nodiscard]] std::int32_t rootOf(std::int32_t run);
  [[nodiscard]] bool mayBeMarker(const Box& box, const DarkMask& mask, int max_px) const;

  DarkRegionOptions options_;
  std::vector<Run> runs_;
  std::vector<std::int32_t> first_run_;  // by row; one more at the end
  std::vector<Box> boxes_;
  std::vector<Extent> rows_;
  std::vector<DarkRegion> regions_;
};

}  // namespace waymark::slam
