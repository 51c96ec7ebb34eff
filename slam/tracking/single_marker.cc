#include "slam/tracking/single_marker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "slam/geometry/reprojection.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

double separation(const std::array<Transform, 2>& a, const std::array<Transform, 2>& b) {
  return rotationDistance(a[0].R, b[0].R) + rotationDistance(a[1].R, b[1].R);
}

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

std::string SingleMarkerOptions::invalidReason() const {
  return firstUnmet({{isPositive(min_log_odds), "min_log_odds must be positive"},
                     {max_log_odds >= min_log_odds, "max_log_odds must be at least min_log_odds"},
                     {isNotNegative(min_barrier), "min_barrier must not be negative"},
                     {isNotNegative(max_gap_s), "max_gap_s must not be negative"}});
}

std::optional<SingleMarkerVerdict> SingleMarkerJudge::judge(
    const KnownMarker& marker, std::int64_t time_ns,
    const std::optional<Transform>& expected_T_w_c) {
  const auto square = estimateSquarePose(*marker.detection, marker.size_m, focal_px_, square_);
  if (!square) {
    track_.reset();
    return std::nullopt;
  }
  std::array<Transform, 2> T_m_c = {square->T_c_m[0].inverse(), square->T_c_m[1].inverse()};
  // What lens and paper add to the corners' noise speaks for neither.
  const double systematic = square_.systematic_sigma_px / focal_px_;
  const double noise = 1.0 + systematic * systematic / cornerVariance(*marker.detection);
  double log_odds = 0.5 * (square->error[1] - square->error[0]) / noise;

  const int id = marker.detection->id;
  const bool goes_on = track_ && track_->marker == id && time_ns >= track_->time_ns &&
                       1e-9 * static_cast<double>(time_ns - track_->time_ns) <= options_.max_gap_s;
  if (goes_on) {
    const std::array<Transform, 2> swapped = {T_m_c[1], T_m_c[0]};
    if (separation(swapped, track_->T_m_c) < separation(T_m_c, track_->T_m_c)) {
      T_m_c = swapped;
      log_odds = -log_odds;
    }
    log_odds += track_->log_odds;
  } else if (expected_T_w_c) {
    const Eigen::Matrix3d R_m_c = marker.T_w_m.R.transpose() * expected_T_w_c->R;
    const bool first = rotationDistance(T_m_c[0].R, R_m_c) < rotationDistance(T_m_c[1].R, R_m_c);
    log_odds = first ? options_.max_log_odds : -options_.max_log_odds;
  }
  const double barrier = barrierBetween(*marker.detection, marker.size_m, *square) / noise;
  if (barrier < options_.min_barrier) log_odds = 0.0;
  log_odds = std::clamp(log_odds, -options_.max_log_odds, options_.max_log_odds);
  track_ = Track{id, time_ns, T_m_c, log_odds};

  const std::size_t better = log_odds >= 0.0 ? 0 : 1;
  return SingleMarkerVerdict{marker.T_w_m * T_m_c[better], marker.T_w_m * T_m_c[1 - better],
                             std::abs(log_odds), barrier,
                             std::abs(log_odds) >= options_.min_log_odds};
}

}  // namespace waymark::slam
