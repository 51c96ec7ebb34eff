// Where an edge lies, from the grey levels of the pixels near it.
//
// A camera makes a blurred step of the border's edge. The maximum-likelihood position of that step
// needs no gradient threshold and leans neither to the dark nor to the light side. The corners at
// either end, the code cells behind the border and the end of the paper's margin are part of the
// model: on small markers they lie within the blur of the edge.
#pragma once

#include <limits>
#include <optional>
#include <string>

#include <Eigen/Core>

#include "slam/detection/edges/edge_rows.h"

namespace waymark::slam {

// How far outwards of an edge nothing is seen of what is behind the paper, however narrow its
// margin is, pixels. T: Lanes or float.
template <typename T>
WAYMARK_INLINE T paperAlone(const T& border_px, float blur_px) {
  constexpr float kNarrowMargin = 0.7F;  // a share of the border
  constexpr float kBehindReach = 2.0F;   // standard deviations of the blur
  return kNarrowMargin * border_px - kBehindReach * blur_px;
}

struct EdgeFit {
  // How far the edge lies outwards of the first guess at its start and end, pixels.
  double shift_start = 0.0;
  double shift_end = 0.0;
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of the two, pixels squared
  double white = 180.0;                                  // grey level outside
  double black = 50.0;                                   // grey level of the border
  double blur_px = 0.9;                                  // standard deviation of the point spread
  // Where the paper ends, if pixels near the edge tell: how much lighter it is behind it, grey
  // levels, and how much wider than the border the paper's white margin is, pixels.
  double behind = 0.0;
  double margin_px = 0.0;
  // How far the edge's middle lies outwards of the line through its ends, if it is curved, and the
  // variance of that, pixels.
  double bow_px = 0.0;
  double bow_variance = 0.0;
  // What the shifts' variances at start and end have in addition where the bow is unknown, too.
  Eigen::Vector2d bent_variance = Eigen::Vector2d::Zero();
  // Of the grey levels, without what does not fit. 0 where nothing is known: levels and blur are
  // guesses then.
  double variance = 0.0;
};

struct EdgeFitOptions {
  int iterations = 5;  // at most; two or three are usual
  // Range of the blur, which is estimated with the edge, pixels.
  double min_blur_px = 0.45;  // a pixel's own extent and any lens
  double max_blur_px = 4.0;   // beyond it there is no edge to speak of
  // Least step between black border and surroundings, grey levels.
  double min_contrast = 15.0;
  // Farthest the edge may lie from the first guess, pixels.
  double max_shift_px = 3.0;
  // Fewer pixels than this say nothing of the unknowns.
  int min_pixels = 16;
  // A pixel's weight has fallen to a half where its squared residual is so many times the variance:
  // three standard deviations.
  double outlier_chi2 = 9.0;
  // Standard deviations of the priors that hold what a short edge cannot tell: how much the levels
  // change from end to end, grey levels, and how much the blur does from the start's, pixels.
  double slope_sigma = 10.0;
  double blur_sigma_px = 0.5;
  // Likewise of what is behind the paper, grey levels about the paper's own, and of most margins'
  // width about the border's, a share of it. A larger share stands other margins better, and knows
  // the edges of small markers less well.
  double behind_sigma = 80.0;
  double margin_sigma = 0.03;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// Gauss-Newton on the grey levels from `start`. enough_px: an edge that is as far from its guess is
// not fitted to the end, as its rows have to be laid out anew. Empty when there are too few pixels,
// too little contrast, or the edge runs away from the guess.
[[nodiscard]] std::optional<EdgeFit> fitEdge(
    const EdgeRows& rows, const EdgeFit& start, const EdgeFitOptions& options,
    double enough_px = std::numeric_limits<double>::infinity());

}  // namespace waymark::slam
