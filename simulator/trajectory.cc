#include "simulator/trajectory.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "simulator/random.h"

namespace waymark::simulator {

slam::Transform cameraPose(const View& view) {
  const double cy = std::cos(view.yaw);
  const double sy = std::sin(view.yaw);
  const double cp = std::cos(view.pitch);
  const double sp = std::sin(view.pitch);
  const Eigen::Vector3d forward(cp * cy, cp * sy, sp);
  const Eigen::Vector3d level_right(sy, -cy, 0.0);
  const Eigen::Vector3d level_down = forward.cross(level_right);
  const Eigen::Vector3d right =
      std::cos(view.roll) * level_right + std::sin(view.roll) * level_down;

  slam::Transform T_w_c;
  T_w_c.R << right, forward.cross(right), forward;
  T_w_c.p = view.position;
  return T_w_c;
}

View viewTowards(const Eigen::Vector3d& position, const Eigen::Vector3d& target) {
  const Eigen::Vector3d d = target - position;
  return {position, std::atan2(d.y(), d.x()), std::atan2(d.z(), std::hypot(d.x(), d.y())), 0.0};
}

Sway::Sway(std::uint64_t seed, double period_s, const Amplitudes& amplitudes) {
  // Hands and steps move a held camera between a few tenths of a hertz and about one.
  constexpr double kFrequenciesHz[] = {0.23, 0.48, 0.95};
  constexpr double kShares[] = {0.55, 0.33, 0.12};
  const double channel_amplitudes[kChannels] = {amplitudes.position_m, amplitudes.position_m,
                                                amplitudes.position_m, amplitudes.yaw,
                                                amplitudes.pitch,      amplitudes.roll};
  Random random(seed, 0x53574159);
  for (int channel = 0; channel < kChannels; ++channel) {
    for (int i = 0; i < 3; ++i) {
      const double wanted = kFrequenciesHz[i] * random.uniform(0.85, 1.15);
      const double cycles = std::max(1.0, std::round(wanted * period_s));
      waves_[channel].push_back({kShares[i] * channel_amplitudes[channel],
                                 2.0 * std::numbers::pi * cycles / period_s,
                                 random.uniform(0.0, 2.0 * std::numbers::pi)});
    }
  }
}

View Sway::apply(View view, double time_s) const {
  double* const values[kChannels] = {&view.position.x(), &view.position.y(), &view.position.z(),
                                     &view.yaw,          &view.pitch,        &view.roll};
  for (int channel = 0; channel < kChannels; ++channel) {
    for (const Wave& wave : waves_[channel]) {
      *values[channel] += wave.amplitude * std::sin(wave.radians_per_s * time_s + wave.phase);
    }
  }
  return view;
}

ClosedSpline::ClosedSpline(std::vector<Eigen::Vector4d> knots, const Eigen::Vector4d& turn)
    : knots_(std::move(knots)), turn_(turn) {}

Eigen::Vector4d ClosedSpline::knot(int index) const {
  const int n = static_cast<int>(knots_.size());
  const int rounds = index >= 0 ? index / n : -((n - 1 - index) / n);
  return knots_[static_cast<std::size_t>(index - rounds * n)] + rounds * turn_;
}

Eigen::Vector4d ClosedSpline::at(double progress) const {
  const double s = progress * static_cast<double>(knots_.size());
  const int i = static_cast<int>(std::floor(s));
  const double u = s - i;
  const double u2 = u * u;
  const double u3 = u2 * u;
  return ((1.0 - 3.0 * u + 3.0 * u2 - u3) * knot(i - 1) + (4.0 - 6.0 * u2 + 3.0 * u3) * knot(i) +
          (1.0 + 3.0 * u + 3.0 * u2 - 3.0 * u3) * knot(i + 1) + u3 * knot(i + 2)) /
         6.0;
}

}  // namespace waymark::simulator
