// Where two edges of a chessboard cross, from the grey levels around.
//
// The blurred crossing is modelled as a whole: two straight edges, one blur, two grey levels. It is
// symmetric about the corner, so that what the model leaves out (a pixel's shape, edges that are
// not quite perpendicular) does not move it.
#pragma once

#include <optional>

#include <Eigen/Core>

#include "base/image_view.h"

namespace waymark::calibration {

struct SaddleFitOptions {
  int iterations = 12;         // at most; four or five are usual
  double start_blur_px = 0.8;  // standard deviation of the point spread
  double min_blur_px = 0.3;
  double max_blur_px = 4.0;
  double min_contrast = 20.0;  // grey levels between black and white
  // What does not fit, as a share of half the contrast: above it this is no crossing.
  double worst_misfit = 0.3;
  // Error that the grey levels do not show (print, paper), pixels.
  double systematic_sigma_px = 0.02;
};

struct Saddle {
  Eigen::Vector2d pixel;
  Eigen::Matrix2d covariance;  // square pixels
  double blur_px = 0.0;
};

// `guess`: within a pixel or two. `axis_a`, `axis_b`: how the two edges run there, to some degrees,
// and how far pixels are used: those in the ellipse guess + u axis_a + v axis_b, u^2 + v^2 <= 1.
// Empty where there is no such crossing.
[[nodiscard]] std::optional<Saddle> fitSaddle(const ImageView& image, const Eigen::Vector2d& guess,
                                              const Eigen::Vector2d& axis_a,
                                              const Eigen::Vector2d& axis_b,
                                              const SaddleFitOptions& options = {});

}  // namespace waymark::calibration
