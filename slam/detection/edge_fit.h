// Where an edge lies, from the grey levels of the pixels near it.
//
// A camera makes a blurred step of the border's edge. The maximum-likelihood position of that step
// needs no gradient threshold and leans neither to the dark nor to the light side. The corners at
// either end and the code cells behind the border are part of the model: on small markers they lie
// within the blur of the edge.
#pragma once

#include <optional>
#include <span>

#include <Eigen/Core>

namespace waymark::slam {

// One pixel near the edge. Distances in pixels.
struct EdgeSample {
  float distance;    // from the first guess of the edge, outwards
  float t;           // along it, 0 at its start, 1 at its end
  float to_start;    // from the side that meets it at its start
  float to_end;      // from the side that meets it at its end
  float thickness;   // of the black border here
  float ring_white;  // how white the code cell behind the border is, 0 .. 1
  float grey;
};

struct EdgeFit {
  // How far the edge lies outwards of the first guess at its start and end, pixels.
  double shift_start = 0.0;
  double shift_end = 0.0;
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of the two, pixels squared
  double white = 180.0;                                  // grey level outside
  double black = 50.0;                                   // grey level of the border
  double blur_px = 0.9;                                  // standard deviation of the point spread
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
};

// Gauss-Newton on the grey levels from `start`. Empty when there are too few pixels, too little
// contrast, or the edge runs away from the guess.
[[nodiscard]] std::optional<EdgeFit> fitEdge(std::span<const EdgeSample> samples,
                                             const EdgeFit& start, const EdgeFitOptions& options);

// The share of a step's height reached `x` standard deviations past it (the Gaussian's distribution
// function).
[[nodiscard]] float blurredStep(float x);

}  // namespace waymark::slam
