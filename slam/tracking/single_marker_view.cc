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

// E[q q^T] of q = theta x (theta x lever) / 2, the term of second order of a turn's arc, where
// theta is normally distributed about zero. Each component is a quadratic form theta^T A theta; its
// moments are those of Isserlis' theorem.
Eigen::Matrix3d arcSecondMoment(const Eigen::Matrix3d& turns, const Eigen::Vector3d& lever) {
  std::array<Eigen::Matrix3d, 3> A_turns;
  for (int i = 0; i < 3; ++i) {
    Eigen::Matrix3d A = -lever(i) * Eigen::Matrix3d::Identity();
    A.row(i) += 0.5 * lever.transpose();
    A.col(i) += 0.5 * lever;
    A_turns[static_cast<std::size_t>(i)] = 0.5 * A * turns;
  }
  Eigen::Matrix3d moment;
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) {
      const Eigen::Matrix3d& a = A_turns[static_cast<std::size_t>(i)];
      const Eigen::Matrix3d& b = A_turns[static_cast<std::size_t>(k)];
      moment(i, k) = a.trace() * b.trace() + 2.0 * (a * b).trace();
    }
  }
  return moment;
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

PoseOfTwo PoseOfTwo::at(const Transform& refined_T_w_c) const {
  const bool same = rotationDistance(refined_T_w_c.R, T_w_c.R) <=
                    rotationDistance(refined_T_w_c.R, other_T_w_c.R);
  return {refined_T_w_c, same ? other_T_w_c : T_w_c,
          marker_w,      same ? log_odds : -log_odds,
          barrier,       same && decided};
}

Matrix6d coverOfOtherPose(const PoseOfTwo& pose, const Matrix6d& view_covariance) {
  const Vector6d apart = pose.T_w_c.localCoordinates(pose.other_T_w_c);
  const Eigen::Vector3d lever = pose.T_w_c.p - pose.marker_w;
  const Eigen::Vector3d turn = apart.tail<3>();
  Vector6d tangent;  // of the way to the other pose, which is a turn about the marker
  tangent << turn.cross(lever), turn;
  // A parabola through the pose and the barrier: sigma^2 of half the way, over the barrier.
  const double secant = 0.25 / std::max(pose.barrier, 1.0);
  Matrix6d cover = secant * tangent * tangent.transpose();
  const Eigen::Matrix3d turns =
      view_covariance.bottomRightCorner<3, 3>() + cover.bottomRightCorner<3, 3>();
  cover.topLeftCorner<3, 3>() += arcSecondMoment(turns, lever);
  const double share = pose.decided ? 0.0 : 1.0 / (1.0 + std::exp(pose.log_odds));
  return cover + share * apart * apart.transpose();
}

double ambiguityOf(const PoseOfTwo& pose, double image, double unambiguous, double min_log_odds) {
  if (pose.decided) return std::max(image, unambiguous);
  const double share = std::clamp(pose.log_odds / min_log_odds, 0.0, 1.0);
  return std::min(image, 1.0 + share * (unambiguous - 1.0));
}

}  // namespace waymark::slam
