// Chooses, while frames come, the views of a board that say something new.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "base/image_view.h"
#include "tools/calibration/board_detector.h"
#include "tools/calibration/coverage.h"

namespace waymark::calibration {

// A view that is kept, with its picture: once the camera is roughly known, it is measured again.
struct View {
  std::string name;  // of the frame, for people
  BoardView board_view;
  int width = 0, height = 0;         // pixels
  std::vector<std::uint8_t> pixels;  // row by row

  [[nodiscard]] ImageView image() const { return {pixels.data(), width, height, width}; }
};

struct ViewCollectorOptions {
  // A view is new where the board's corners have moved by this share of the picture's diagonal,
  // root mean square. It grows when there are too many.
  double novelty = 0.015;
  std::size_t max_views = 70;  // more cost time and memory and hardly change a camera any more
  // One as good as known takes the place of an old one where its blur is that much smaller.
  double sharper = 0.85;
  // A blur of this many times the median is motion; such views are left out at the end.
  double worst_blur = 1.6;
};

class ViewCollector {
 public:
  ViewCollector(const Board& board, int width, int height,
                const ViewCollectorOptions& options = {});

  // Keeps the view, or puts it in the place of a blurred one like it, or does nothing.
  void offer(std::string name, BoardView board_view, const ImageView& image);

  // Without those that are blurred against the others.
  [[nodiscard]] std::vector<View> take() &&;

  [[nodiscard]] std::size_t count() const { return views_.size(); }
  // Views with more are motion, beside the others; pixels. Infinite where there are none.
  [[nodiscard]] double worstBlur() const;
  // Of all views that were offered, kept or not.
  [[nodiscard]] const Coverage& coverage() const { return coverage_; }

 private:
  // Where the corners of the board lie in the picture, or would lie, pixels.
  using Signature = std::array<Eigen::Vector2d, 4>;
  struct Kept {
    View view;
    Signature signature;
  };

  [[nodiscard]] Signature signatureOf(const BoardView& board_view) const;
  // Share of the picture's diagonal between two views.
  [[nodiscard]] double distance(const Signature& a, const Signature& b) const;
  void thinOut();

  const Board& board_;
  ViewCollectorOptions options_;
  double diagonal_px_;
  Coverage coverage_;
  std::array<Eigen::Vector2d, 4> board_corners_;  // metres
  std::vector<Kept> views_;
};

}  // namespace waymark::calibration
