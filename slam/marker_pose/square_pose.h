// The pose of one marker from its four corners: both solutions of the planar ambiguity
// (seed 1, section 3.2, Eq. 11-12; Collins and Bartoli's IPPE, the seed's reference [17]).
#pragma once

#include <optional>
#include <string>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

struct SquarePoseOptions {
  // Error a corner may have beyond its covariance (lens model, bent paper), pixels at the image
  // centre. It keeps the ratio of two tiny errors from passing for certainty.
  double systematic_sigma_px = 0.10;
  // Added to both squared errors before their ratio is taken, without unit. Noise alone can make
  // one of two good fits three times better than the other; at tau_e = 3 this asks for a difference
  // of at least twice the value, that is odds of e^5 for 5.
  double evidence_floor = 5.0;
  // Of each solution, at most. More come nearer to the minimum and cost time.
  int refinement_iterations = 10;
  // Solutions that end up turned by less than this against each other are one, radians: more than
  // two ways into one minimum differ by, far less than two minima do.
  double same_rotation_rad = 0.01;
  // Chi-square of a marker that a pose puts behind the camera, and the most that anything counts
  // for when the motions between two frames are compared: worse than any fit worth comparing, yet
  // finite, so that sums over several markers still tell poses apart.
  double unseen_chi2 = 1e6;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// theta_m^t of Eq. 12: sorted, error[0] <= error[1].
struct SquarePose {
  std::array<Transform, 2> T_c_m;
  // Sum of the squared whitened residuals of the four corners (8 of them), without unit: about 2
  // for a right solution (8 residuals less 6 parameters).
  std::array<double, 2> error{};
  // error[1] / error[0] with the systematic error and the floor added to both: 1 is a coin toss.
  // The paper's tau_e applies to this.
  double ratio = 1.0;

  [[nodiscard]] bool unambiguous(double tau_e) const { return ratio > tau_e; }
};

// Mean variance of a detection's corner coordinates, normalized.
[[nodiscard]] inline double cornerVariance(const MarkerDetection& detection) {
  double variance = 0.0;
  for (const Eigen::Matrix2d& covariance : detection.covariance) {
    variance += covariance.trace() / 8.0;
  }
  return variance;
}

// What is added to the squared whitened errors of `views` views of a marker before two hypotheses
// are compared; see SquarePoseOptions. corner_variance: mean variance of a corner coordinate,
// normalized.
[[nodiscard]] inline double comparisonFloor(double corner_variance, double focal_px, int views,
                                            const SquarePoseOptions& options) {
  const double systematic = options.systematic_sigma_px / focal_px;
  // A view has two degrees of freedom: 8 residuals less 6 parameters.
  return options.evidence_floor + 2.0 * views * systematic * systematic / corner_variance;
}

// Both IPPE solutions, each refined by Gauss-Newton on the whitened reprojection error. Empty for
// corners that are not the convex image of a square in front of the camera.
// focal_px converts the systematic sigma to normalized units.
[[nodiscard]] std::optional<SquarePose> estimateSquarePose(const MarkerDetection& detection,
                                                           double size_m, double focal_px,
                                                           const SquarePoseOptions& options = {});

// Where the marker is known to be at T_c_m: the pose that its corners alone would take for another
// one. Empty for corners that are not the convex image of a square.
[[nodiscard]] std::optional<Transform> otherSquarePose(const MarkerDetection& detection,
                                                       double size_m, const Transform& T_c_m,
                                                       const SquarePoseOptions& options = {});

}  // namespace waymark::slam
