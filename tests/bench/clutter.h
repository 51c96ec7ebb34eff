// Pictures full of things that look like markers, and are none.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "base/image_view.h"
#include "simulator/random.h"

namespace waymark::bench {

// Squares seen from all sides - plain, framed, with cells in grids of all sizes, chessboards,
// stripes - and lines of what might be writing, on an uneven ground, blurred a little and noisy.
class ClutterPainter {
 public:
  // marker_cells: a grid with as many cells across, border and all, is left out: with random cells
  // it would be a random code, and now and then a right one.
  ClutterPainter(int width, int height, int marker_cells, double noise_sigma);

  // The same for the same seed. Valid until the next call.
  ImageView paint(std::uint64_t seed);

 private:
  enum class Kind { kPlain, kFrame, kCells, kChessboard, kStripes };
  static constexpr int kKinds = 5;
  static constexpr int kMaxCells = 12;
  using Quad = std::array<Eigen::Vector2d, 4>;

  void paintGround(simulator::Random* random);
  [[nodiscard]] Quad randomQuad(simulator::Random* random) const;
  void paintSquare(simulator::Random* random);
  void paintWriting(simulator::Random* random);
  // level(u, v): the grey level at a place of the unit square.
  template <typename Level>
  void fill(const Quad& quad, const Level& level);

  int width_;
  int height_;
  int marker_cells_;
  double noise_sigma_;
  std::vector<float> light_;
  std::vector<std::uint8_t> pixels_;
};

}  // namespace waymark::bench
