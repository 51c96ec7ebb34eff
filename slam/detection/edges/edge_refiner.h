// Sub-pixel corners of a marker: a line is fitted to the grey-level edge along each side, in
// undistorted coordinates (edge_fit.h), and the corners are the lines' intersections.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include <Eigen/Core>

#include "base/image_view.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/detection/edges/edge_fit.h"
#include "slam/detection/edges/edge_rows.h"
#include "slam/detection/edges/marker_side.h"
#include "slam/detection/edges/placed_image.h"
#include "slam/geometry/camera_model.h"

namespace waymark::slam {

// How far from a side, and how near its ends, its pixels are looked at. Wide enough for the blur
// (so many pixels for each of its standard deviations, and some more), but not beyond what the
// model knows: inside, the cells behind the border are known only with the code; outside, the paper
// has a white margin about as wide as the border, and then anything.
struct EdgeWindowOptions {
  double reach_per_blur = 2.5;  // pixels a pixel of blur
  double reach_px = 0.7;        // and these
  double min_reach_px = 1.5;    // however thin the border is
  // Outside there are these more: a small marker's margin ends within them, and what is behind it
  // has to be seen to be known. More knows the white better, and sees more of what is no paper.
  double more_outside_px = 1.0;
  // Shares of the border's thickness.
  double max_outside = 1.6;
  double max_inside = 1.0;
  double max_inside_without_code = 0.6;
  // At the ends, where the corners are round: left out.
  double end_per_blur = 1.2;  // pixels a pixel of blur
  double end_px = 0.5;        // and these
  double max_end = 0.25;      // a share of the side's length

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct EdgeRefinerOptions {
  EdgeFitOptions fit;
  EdgeWindowOptions window;
  // Blur to start from where none is known, standard deviation in pixels.
  double initial_blur_px = 0.9;
  // Rows of pixels across a side that are used, at most: few to decide whether a candidate is a
  // marker at all, more for its corners. More costs time and averages more noise.
  int rows_rough = 16;
  int rows_fine = 64;
  // A fit that moved a side by more than this is done again around the new place, pixels.
  double settled_shift_px = 0.5;
  // Where the edge was far from the first guess, the window is laid around it and fitted again: so
  // many fits at most. The second one is as good as any later one.
  int passes = 2;
  // A side is curved (bent paper, a lens that is not as given) where its bow has a chi-square
  // beyond this, and is as large as this, pixels ...
  double bow_chi2 = 25.0;
  double min_bow_px = 0.1;
  // ... it is fitted so often again around the curve, at most ...
  int bent_passes = 3;
  // ... and as the corners of bent paper are not those of a square, all four may be off by this
  // share of the largest bow. More takes weight from flat prints whose sides a lens bends.
  double bow_share = 0.5;
  // Where the blur is a larger share of the border's thickness than `narrow_border`, cells and what
  // is behind the paper reach the edge in ways that no model has. The error of a side by that, in
  // units of the blur, for each unit of the share.
  double narrow_border = 0.15;
  double narrow_border_sigma = 0.3;
  // A border that is thinner than the least window (window.min_reach_px) shows what is beyond it:
  // the error of a side by that, for each pixel of the difference.
  double beyond_border_sigma = 0.5;
  // What follows is for soft edges: with this blur and more, pixels of the camera's image.
  double soft_blur_px = 0.85;
  // Where the paper's margin is narrow, what is behind it darkens the window's outer end: beyond
  // `margin_far` standard deviations of the blur residuals are darker than nearer to the edge,
  // beyond chance (chi-square), by a share of the contrast. For each unit of that share the side is
  // off by `margin_sigma` standard deviations of the blur.
  double margin_chi2 = 9.0;
  double margin_far = 2.0;
  double margin_sigma = 8.0;
  // Sides that meet at an angle with a smaller sine than this have no corner worth its name.
  double min_corner_sine = 0.05;
  // Error of a corner that the grey levels do not show (print, paper, lens model), pixels.
  double systematic_sigma_px = 0.03;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// The ring of code cells next to the border, in the order of the corners given to refine(): bit j
// of white[s] is cell j along side s, counted from corner s on.
struct InnerRing {
  int cells_per_side = 0;  // code cells; the border adds one at either end
  std::array<std::uint32_t, 4> white{};

  [[nodiscard]] static InnerRing of(const Dictionary& dictionary, int id);

  // Whether the cell after j whole ones is white, counted with the border: 0 or 1. Outside of the
  // ring nothing is.
  [[nodiscard]] float cell(std::size_t side, int j) const {
    const int index = j - 1;
    return index >= 0 && index < cells_per_side && ((white[side] >> index) & 1U) != 0 ? 1.0F : 0.0F;
  }
};

// How the edge of each side looks, side k running from corner k to corner k + 1.
using SideFits = std::array<EdgeFit, 4>;

struct RefinedQuad {
  std::array<Eigen::Vector2d, 4> pixels;      // distorted, of the camera's image
  std::array<Eigen::Vector2d, 4> normalized;  // undistorted
  std::array<Eigen::Matrix2d, 4> covariance;  // of normalized
  SideFits edges;
};

class EdgeRefiner {
 public:
  // The camera must outlive the refiner.
  explicit EdgeRefiner(const CameraModel& camera, const EdgeRefinerOptions& options = {});

  // `corners`: normalized, clockwise in the image, good to about a pixel and a half. `cells`: cells
  // along a side with the border. `ring` (may be null: the code is not known, and the corners come
  // out roughly) must be in the order of the corners. `edges`: how they looked a frame before, or
  // in a rough refinement, in an image of the same factor; without it (null) there is a rough one
  // first. Empty when a side has too little contrast or too few pixels, or runs away from the
  // guess.
  [[nodiscard]] std::optional<RefinedQuad> refine(const PlacedImage& image,
                                                  const std::array<Eigen::Vector2d, 4>& corners,
                                                  int cells, const InnerRing* ring,
                                                  const SideFits* edges = nullptr);

 private:
  // Fills rows_ with the pixels near side `index`.
  void layOutRows(const PlacedImage& placed, const std::array<MarkerSide, 4>& sides,
                  std::size_t index, const InnerRing* ring, int max_rows, double blur_px);
  [[nodiscard]] bool isSoft(double blur_px, const PlacedImage& placed) const {
    return placed.factor * blur_px >= options_.soft_blur_px;
  }

  // What straight, clean sides do not have.
  struct SideShapes {
    std::array<double, 4> bow_px{};           // outwards; 0 where a side is straight
    std::array<double, 4> narrow_variance{};  // of a side's place, pixels squared

    [[nodiscard]] double largestBow_px() const;
    [[nodiscard]] int passes(const EdgeRefinerOptions& options) const;
  };
  // The corners, from the sides' fits. False where two sides are nearly parallel.
  [[nodiscard]] bool meetSides(const std::array<MarkerSide, 4>& sides, const SideShapes& shapes,
                               RefinedQuad* quad) const;

  const CameraModel& camera_;
  EdgeRefinerOptions options_;
  // Reused from side to side.
  EdgeRows rows_;
  std::array<std::int32_t, EdgeRows::kMaxRows> first_sample_{};  // by row, a pixel coordinate
};

}  // namespace waymark::slam
