// Levenberg-Marquardt over one pose: the loop that tracking (seed 1, Eq. 22), the square's pose and
// the marker's pose over several views (Eq. 26) share.
#pragma once

#include <algorithm>
#include <optional>

#include "slam/geometry/transform.h"

namespace waymark::slam {

// The cost at a pose and its normal equations by Transform::retract's delta.
struct PoseNormal {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  double cost = 0.0;
};

struct MinimizedPose {
  Transform T;
  PoseNormal normal;        // at T
  double start_cost = 0.0;  // where it began
};

// The step of Levenberg-Marquardt, the diagonal raised by `lambda`.
[[nodiscard]] Vector6d dampedStep(const PoseNormal& normal, double lambda);

// The covariance that goes with a normal matrix. Empty where that is not positive.
[[nodiscard]] std::optional<Matrix6d> inverseOf(const Matrix6d& H);

// `linearize(T, &normal)` adds to a zeroed normal and returns false where T has no cost (a corner
// behind the camera). Empty when the start has none.
template <typename Linearize>
[[nodiscard]] std::optional<MinimizedPose> minimizePose(const Transform& start, int max_iterations,
                                                        const Linearize& linearize) {
  constexpr double kConverged = 1e-9;  // relative fall of the cost
  constexpr double kHopeless = 1e8;    // damping beyond which no step will help
  MinimizedPose best{start, {}, 0.0};
  if (!linearize(start, &best.normal)) return std::nullopt;
  best.start_cost = best.normal.cost;
  double lambda = 1e-5;
  for (int i = 0; i < max_iterations && lambda < kHopeless; ++i) {
    const Vector6d step = dampedStep(best.normal, lambda);
    if (!step.allFinite()) break;
    const Transform candidate = best.T.retract(step);
    PoseNormal next;
    if (linearize(candidate, &next) && next.cost <= best.normal.cost) {
      const bool converged = best.normal.cost - next.cost <= kConverged * best.normal.cost;
      best.T = candidate;
      best.normal = next;
      lambda = std::max(0.1 * lambda, 1e-9);
      if (converged) break;
    } else {
      lambda = std::max(10.0 * lambda, 1e-4);
    }
  }
  return best;
}

}  // namespace waymark::slam
