// Sub-pixel corners of a marker: a line is fitted to the grey-level edge along each side, in
// undistorted coordinates, and the corners are the lines' intersections.
//
// The edge is modelled as what a camera makes of it: a step between two grey levels, blurred by a
// symmetric point spread. The maximum-likelihood position of that step needs no gradient threshold
// and has no bias towards the dark or the light side. Where the marker's code is known, so is the
// first ring of cells inside the black border, and its edges are part of the model: on small
// markers they lie within the blur of the outer edge.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include <Eigen/Core>

#include "base/image_view.h"
#include "slam/detection/dictionary.h"
#include "slam/detection/undistortion_table.h"
#include "slam/geometry/camera_model.h"

namespace waymark::slam {

struct EdgeRefinerOptions {
  int iterations = 5;  // at most, per pass; two or three are usual
  // Rows of pixels across a side that are used, at most: few to decide whether a candidate is a
  // marker at all, more for its corners. More costs time and averages more noise.
  int rows_rough = 16;
  int rows_fine = 64;
  // Blur to start from, standard deviation in pixels; it is estimated from there.
  double initial_blur_px = 0.9;
  double min_blur_px = 0.45;  // a pixel's own extent and any lens
  double max_blur_px = 4.0;   // beyond it there is no edge to speak of
  // Least step between black border and surroundings, grey levels.
  double min_contrast = 15.0;
  // Farthest a side may move from the first guess, pixels.
  double max_shift_px = 3.0;
  // Error of a corner that the grey levels do not show (print, paper, lens model), pixels.
  double systematic_sigma_px = 0.03;
};

// The ring of code cells next to the border, in the order of the corners given to refine(): bit j
// of white[s] is cell j along side s, counted from corner s on.
struct InnerRing {
  int cells_per_side = 0;  // code cells; the border adds one at either end
  std::array<std::uint32_t, 4> white{};

  [[nodiscard]] static InnerRing of(const Dictionary& dictionary, int id);
};

struct RefinedQuad {
  std::array<Eigen::Vector2d, 4> pixels;      // distorted
  std::array<Eigen::Vector2d, 4> normalised;  // undistorted
  std::array<Eigen::Matrix2d, 4> covariance;  // of normalised
  double black = 0.0;                         // grey level of the border
  double white = 0.0;                         // grey level around it
  double blur_px = 0.0;  // mean standard deviation of the point spread over the four sides
};

class EdgeRefiner {
 public:
  // Both references must outlive the refiner.
  EdgeRefiner(const CameraModel& camera, const UndistortionTable& table,
              const EdgeRefinerOptions& options = {});

  // `corners_px`: clockwise in the image, good to about a pixel and a half. `cells`: cells along a
  // side with the border. `ring` (may be null) must be in the order of the corners. Empty when a
  // side has too little contrast or too few pixels, or runs away from the guess.
  [[nodiscard]] std::optional<RefinedQuad> refine(const ImageView& image,
                                                  const std::array<Eigen::Vector2d, 4>& corners_px,
                                                  int cells, const InnerRing* ring) const;

 private:
  struct Side;
  struct SideFit;
  [[nodiscard]] std::optional<std::array<Side, 4>> layOut(
      const std::array<Eigen::Vector2d, 4>& normalised, int cells) const;
  [[nodiscard]] std::optional<SideFit> fitSide(const ImageView& image, const Side& side,
                                               const InnerRing* ring, int index,
                                               const SideFit& start) const;

  const CameraModel& camera_;
  const UndistortionTable& table_;
  EdgeRefinerOptions options_;
};

}  // namespace waymark::slam
