#include "slam/tracking/single_marker.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/elapsed.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

double separation(const std::array<Transform, 2>& a, const std::array<Transform, 2>& b) {
  return rotationDistance(a[0].R, b[0].R) + rotationDistance(a[1].R, b[1].R);
}

}  // namespace

std::string SingleMarkerOptions::invalidReason() const {
  return firstUnmet(
      {{isPositive(min_log_odds), "min_log_odds must be positive"},
       {max_log_odds >= min_log_odds, "max_log_odds must be at least min_log_odds"},
       {isNotNegative(min_barrier), "min_barrier must not be negative"},
       {isNotNegative(max_undecided_sigma_rad), "max_undecided_sigma_rad must not be negative"},
       {isNotNegative(max_gap_s), "max_gap_s must not be negative"}});
}

std::optional<PoseOfTwo> SingleMarkerJudge::judge(const KnownMarker& marker, std::int64_t time_ns,
                                                  const std::optional<Transform>& expected_T_w_c) {
  const auto view = viewSingleMarker(marker, focal_px_, square_);
  if (!view) {
    track_.reset();
    return std::nullopt;
  }
  std::array<Transform, 2> T_m_c = view->T_m_c;
  double of_image = view->log_odds;  // of the first over the second, as log_odds

  const int id = marker.detection->id;
  const bool goes_on = track_ && track_->marker == id && time_ns >= track_->time_ns &&
                       secondsBetween(track_->time_ns, time_ns) <= options_.max_gap_s;
  double log_odds = of_image;
  if (goes_on) {
    const std::array<Transform, 2> swapped = {T_m_c[1], T_m_c[0]};
    if (separation(swapped, track_->T_m_c) < separation(T_m_c, track_->T_m_c)) {
      T_m_c = swapped;
      of_image = -of_image;
    }
    log_odds = track_->log_odds + of_image;
  } else if (expected_T_w_c) {
    const Eigen::Matrix3d R_m_c = marker.T_w_m.R.transpose() * expected_T_w_c->R;
    const bool first = rotationDistance(T_m_c[0].R, R_m_c) < rotationDistance(T_m_c[1].R, R_m_c);
    log_odds = first ? options_.max_log_odds : -options_.max_log_odds;
  }
  double barrier = view->barrier;
  if (barrier < options_.min_barrier) {
    // The image for itself: where its corners fit the one much better than all that is towards the
    // other, there is only the one.
    log_odds = of_image;
    barrier += 2.0 * view->log_odds;
  }
  log_odds = std::clamp(log_odds, -options_.max_log_odds, options_.max_log_odds);
  track_ = Track{id, time_ns, T_m_c, log_odds};

  const std::size_t better = log_odds >= 0.0 ? 0 : 1;
  return PoseOfTwo{marker.T_w_m * T_m_c[better],
                   marker.T_w_m * T_m_c[1 - better],
                   marker.T_w_m.p,
                   std::abs(log_odds),
                   barrier,
                   std::abs(log_odds) >= options_.min_log_odds};
}

}  // namespace waymark::slam
