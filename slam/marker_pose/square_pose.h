// The pose of one marker from its four corners: both solutions of the planar ambiguity
// (seed 1, section 3.2, Eq. 11-12; Collins and Bartoli's IPPE, the seed's reference [17]).
#pragma once

#include <optional>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

struct SquarePoseOptions {
  // Error a corner may have beyond its covariance (lens model, bent paper), pixels at the image
  // centre. It keeps the ratio of two tiny errors from passing for certainty.
  double systematic_sigma_px = 0.10;
  int refinement_iterations = 10;
};

// theta_m^t of Eq. 12: sorted, error[0] <= error[1].
struct SquarePose {
  std::array<Transform, 2> T_c_m;
  // Sum of the squared whitened residuals of the four corners (8 of them), without unit: about 2
  // for a right solution (8 residuals less 6 parameters).
  std::array<double, 2> error{};
  // error[1] / error[0] with the systematic error added to both: 1 is a coin toss. The paper's
  // tau_e applies to this.
  double ratio = 1.0;

  [[nodiscard]] bool unambiguous(double tau_e) const { return ratio > tau_e; }
};

// Both IPPE solutions, each refined by Gauss-Newton on the whitened reprojection error. Empty for
// corners that are not the convex image of a square in front of the camera.
// focal_px converts the systematic sigma to normalised units.
[[nodiscard]] std::optional<SquarePose> estimateSquarePose(const MarkerDetection& detection,
                                                           double size_m, double focal_px,
                                                           const SquarePoseOptions& options = {});

}  // namespace waymark::slam
