// Of FilterState: the scale, which no image tells.
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/vectorized.h"
#include "slam/natural/filter/filter_state.h"

namespace waymark::slam {
namespace {

// The scale's direction is not followed where a standard deviation of it has moved no coordinate by
// more than this: metres, metres per second, 1 / metres.
constexpr double kNegligible = 1e-5;
// Depths that are each unknown by themselves tell no scale: what they have in common is so many
// times what would be left of their mean, as variances.
constexpr double kInCommon = 8.0;
constexpr double kExact = 1e-12;  // no depth is known better than to a part in a million

// column += a u + b q
WAYMARK_VECTORIZED void add(double a, const double* u, double b, const double* q, int n,
                            double* column) {
  for (int i = 0; i < n; ++i) column[i] += a * u[i] + b * q[i];
}

// A marker's distance from the camera is seen: its size is known.
bool growsWithScale(const StatePose& pose) {
  return pose.offset >= 0 && pose.kind != PoseKind::kMarker;
}

}  // namespace

// The mean of the inverse depths' logarithms, weighed by how well each is known.
double FilterState::findGauge() {
  gauge_.assign(static_cast<std::size_t>(size_), 0.0);
  double weights = 0.0;
  for (const StateFeature& feature : features_) {
    if (feature.offset < 0 || !(feature.rho > 0.0)) continue;
    const int at = feature.offset + 2;
    const double weight = 1.0 / std::max(kExact, P(at, at) / (feature.rho * feature.rho));
    gauge_[static_cast<std::size_t>(at)] = -weight / feature.rho;
    weights += weight;
  }
  if (!(weights > 0.0)) return 0.0;
  for (double& g : gauge_) g /= weights;
  return 1.0 / weights;
}

double FilterState::scaleSigma() {
  (void)findGauge();
  return std::sqrt(std::max(0.0, findShared()));
}

double FilterState::findCommonScale() {
  const double of_their_own = findGauge();
  const double variance = findShared();
  if (variance > kInCommon * of_their_own) return variance;
  std::fill(gauge_.begin(), gauge_.end(), 0.0);
  std::fill(shared_.begin(), shared_.end(), 0.0);
  return 0.0;
}

double FilterState::findShared() {
  const auto n = static_cast<std::size_t>(size_);
  shared_.assign(n, 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    if (gauge_[i] == 0.0) continue;
    const double* const column = P_.data() + static_cast<std::ptrdiff_t>(i) * stride_;
    add(gauge_[i], column, 0.0, column, size_, shared_.data());
  }
  double variance = 0.0;
  for (std::size_t i = 0; i < n; ++i) variance += gauge_[i] * shared_[i];
  return variance;
}

void FilterState::findScaleDirection() {
  scale_direction_.assign(static_cast<std::size_t>(size_), 0.0);
  double* const direction = scale_direction_.data();
  Eigen::Map<Eigen::Vector3d>(direction + kVelocityAt) = v_w_;
  for (const StatePose& pose : poses_) {
    if (!growsWithScale(pose)) continue;
    Eigen::Map<Eigen::Vector3d>(direction + pose.offset) = pose.T_w_s.p - T_w_c_.p;
  }
  for (const StateFeature& feature : features_) {
    if (feature.offset >= 0) direction[feature.offset + 2] = -feature.rho;
  }
}

void FilterState::correct(const double* delta) {
  const auto n = static_cast<std::size_t>(size_);
  (void)findCommonScale();
  findScaleDirection();
  double log_scale = 0.0;
  for (std::size_t i = 0; i < n; ++i) log_scale += gauge_[i] * delta[i];
  slope_.assign(delta, delta + n);
  for (std::size_t i = 0; i < n; ++i) slope_[i] -= log_scale * scale_direction_[i];
  move(slope_.data());
  enlarge(std::exp(log_scale));
}

void FilterState::enlarge(double factor) {
  v_w_ *= factor;
  for (StatePose& pose : poses_) {
    if (growsWithScale(pose)) pose.T_w_s.p = T_w_c_.p + factor * (pose.T_w_s.p - T_w_c_.p);
  }
  for (StateFeature& feature : features_) {
    if (feature.offset >= 0) feature.rho /= factor;
  }
}

// An error e becomes e + (after - before) g(e), where g, the gauge, tells the scale's part of it:
// so the direction before becomes the one after, and what has nothing of it stays.
void FilterState::followScale(double* error) {
  const auto n = static_cast<std::size_t>(size_);
  const double variance = findShared();
  slope_ = scale_direction_;
  findScaleDirection();
  double most = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    slope_[i] = scale_direction_[i] - slope_[i];
    most = std::max(most, std::abs(slope_[i]));
  }
  if (!(variance * most * most > kNegligible * kNegligible)) return;
  for (std::size_t k = 0; k < n; ++k) {
    add(shared_[k] + variance * slope_[k], slope_.data(), slope_[k], shared_.data(), size_,
        P_.data() + static_cast<std::ptrdiff_t>(k) * stride_);
  }
  if (error == nullptr) return;
  double part = 0.0;
  for (std::size_t i = 0; i < n; ++i) part += gauge_[i] * error[i];
  for (std::size_t i = 0; i < n; ++i) error[i] += part * slope_[i];
}

void FilterState::scaleAbout(int pose, double scale, double sigma) {
  const Transform T_w_s = poses_[static_cast<std::size_t>(pose)].T_w_s;
  moveWorld(T_w_s.inverse());  // a scaled position is its error's scale, too
  // Of each coordinate, what it is multiplied by, and what it moves by with the scale's logarithm.
  factor_.assign(static_cast<std::size_t>(size_), 1.0);
  slope_.assign(static_cast<std::size_t>(size_), 0.0);
  const auto place = [&](int offset, const Eigen::Vector3d& scaled) {
    for (int i = 0; i < 3; ++i) {
      factor_[static_cast<std::size_t>(offset + i)] = scale;
      slope_[static_cast<std::size_t>(offset + i)] = scaled[i];
    }
  };
  T_w_c_.p *= scale;
  v_w_ *= scale;
  place(kPositionAt, T_w_c_.p);
  place(kVelocityAt, v_w_);
  for (StatePose& other : poses_) {
    if (other.offset < 0) continue;
    other.T_w_s.p *= scale;
    place(other.offset, other.T_w_s.p);
  }
  for (StateFeature& feature : features_) {
    if (feature.offset < 0) continue;
    feature.rho /= scale;
    factor_[static_cast<std::size_t>(feature.offset + 2)] = 1.0 / scale;
    slope_[static_cast<std::size_t>(feature.offset + 2)] = -feature.rho;
  }
  for (int c = 0; c < size_; ++c) {
    double* const column = P_.data() + static_cast<std::ptrdiff_t>(c) * stride_;
    const double factor = factor_[static_cast<std::size_t>(c)];
    for (int r = 0; r < size_; ++r) column[r] *= factor_[static_cast<std::size_t>(r)] * factor;
  }
  // An error e becomes e - slope g(e), without what the scale was in doubt by before.
  const double before = findCommonScale();
  for (int k = 0; k < size_; ++k) {
    const auto at = static_cast<std::size_t>(k);
    add((before + sigma * sigma) * slope_[at] - shared_[at], slope_.data(), -slope_[at],
        shared_.data(), size_, P_.data() + static_cast<std::ptrdiff_t>(k) * stride_);
  }
  moveWorld(T_w_s);
}

}  // namespace waymark::slam
