// Where something has come into view: what was dark on a line along the image's border in the frame
// before, and is not any more, may now lie within the image as a whole. So a marker that enters is
// found at once, at the price of a few lines.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/image_view.h"
#include "slam/detection/search/window.h"

namespace waymark::slam {

struct BorderEntryOptions {
  // A pixel is dark below this many sixteenths of the mean around it, and so many grey levels below
  // that.
  int dark_sixteenths = 15;
  int dark_offset = 3;
  // Shorter runs of dark pixels are noise, pixels at the line's size.
  int min_run_px = 2;
  // How far the scene may move along the border from frame to frame, pixels at the line's size:
  // what was dark and is still there within it has not come in.
  int near_px = 3;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

class BorderEntryDetector {
 public:
  // At sizes from the whole down to 1/coarsest of it, by halves; reach_px: how large a marker is
  // that is to be found at each of them, pixels at that size.
  BorderEntryDetector(int width, int height, int coarsest, int reach_px,
                      const BorderEntryOptions& options = {});

  // The parts of this frame that are worth a search, coarse before fine. Valid until the next call.
  std::span<const SearchRegion> next(const ImageView& image);

 private:
  enum Border { kLeft, kRight, kTop, kBottom };
  [[nodiscard]] static bool isUpright(Border border) { return border == kLeft || border == kRight; }
  // Of dark pixels along a line, both included.
  struct Run {
    int first = 0;
    int last = 0;
  };
  struct Line {
    Border border = kLeft;
    int factor = 1;
    std::vector<Run> runs;  // in the last frame
  };

  [[nodiscard]] int lengthOf(const Line& line) const;
  void sample(const ImageView& image, const Line& line);
  void findRuns(int length);
  void addWindows(const Line& line);
  [[nodiscard]] SearchRegion windowAt(const Line& line, const Run& gone) const;

  int width_;
  int height_;
  int reach_px_;
  BorderEntryOptions options_;
  std::vector<Line> lines_;
  std::vector<SearchRegion> due_;
  // Along a line, reused from one to the next.
  std::vector<std::uint8_t> grey_;   // and beyond both ends
  std::vector<std::uint16_t> sums_;  // of what is around a pixel
  std::vector<std::uint8_t> dark_;   // 1 where it is; and some zeros
  std::vector<Run> runs_;            // in this frame
};

}  // namespace waymark::slam
