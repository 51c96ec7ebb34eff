#include "slam/tracking/single_marker_view.h"

#include <algorithm>
#include <cmath>

#include "slam/geometry/reprojection.h"

namespace waymark::slam {
namespace {

// How much worse than either of two poses the one half-way between them explains the corners, in
// squared whitened residuals.
double barrierBetween(const MarkerDetection& detection, double size_m, const SquarePose& square) {
  const auto& [first, second] = square.T_c_m;
  const Transform half_way{
      first.R * expSo3(0.5 * logSo3(Eigen::Matrix3d(first.R.transpose() * second.R))),
      0.5 * (first.p + second.p)};
  const WhitenedCorners W = whitening(detection.covariance);
  const auto corners_m = markerCorners(size_m);
  double error = 0.0;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto squared =
        squaredError(half_way.inverse(), corners_m[k], detection.normalized[k], W[k]);
    if (!squared) return 0.0;
    error += *squared;
  }
  return error - square.error[1];
}

}  // namespace

std::optional<SingleMarkerView> viewSingleMarker(const KnownMarker& marker, double focal_px,
                                                 const SquarePoseOptions& options) {
  const auto square = estimateSquarePose(*marker.detection, marker.size_m, focal_px, options);
  if (!square) return std::nullopt;
  const double systematic = options.systematic_sigma_px / focal_px;
  const double noise = 1.0 + systematic * systematic / cornerVariance(*marker.detection);
  return SingleMarkerView{{square->T_c_m[0].inverse(), square->T_c_m[1].inverse()},
                          0.5 * (square->error[1] - square->error[0]) / noise,
                          barrierBetween(*marker.detection, marker.size_m, *square) / noise};
}

Matrix6d coverOfOtherPose(const PoseOfTwo& pose) {
  const Vector6d apart = pose.T_w_c.localCoordinates(pose.other_T_w_c);
  // A parabola through the pose and the barrier: sigma^2 of half the way, over the barrier.
  const double secant = 0.25 / std::max(pose.barrier, 1.0);
  const double share = pose.decided ? 0.0 : 1.0 / (1.0 + std::exp(pose.log_odds));
  return (secant + share) * apart * apart.transpose();
}

double ambiguityOf(const PoseOfTwo& pose, double image, double unambiguous, double min_log_odds) {
  if (pose.decided) return std::max(image, unambiguous);
  const double share = std::min(pose.log_odds / min_log_odds, 1.0);
  return std::min(image, 1.0 + share * (unambiguous - 1.0));
}

}  // namespace waymark::slam
