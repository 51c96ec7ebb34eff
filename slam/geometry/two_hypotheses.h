// The best of several hypotheses about a pose, and its strongest rival: what planar markers leave
// open is decided by comparing the two (seed 1, tau_e in sections 4.1, 4.5, 4.8 and 4.9).
#pragma once

#include <optional>
#include <ranges>

#include "slam/geometry/transform.h"

namespace waymark::slam {

// Whether two poses are hypotheses of their own: turned against each other by at least so much.
[[nodiscard]] inline bool isAnotherPose(const Transform& a, const Transform& b,
                                        double other_rotation_rad) {
  return !(rotationDistance(a.R, b.R) < other_rotation_rad);
}

// The first of the candidates, which come best first, that is another pose than `best` and stays
// one when it is refined; refined. Empty when there is none. `best`: the best candidate, refined.
// refine(candidate): an optional, empty for one that comes to nothing. poseOf(candidate) and
// poseOf(refined): their Transform.
template <std::ranges::input_range Candidates, typename Refine, typename PoseOf>
[[nodiscard]] auto otherHypothesis(const Candidates& candidates, const Transform& best,
                                   double other_rotation_rad, Refine refine, PoseOf poseOf)
    -> decltype(refine(*std::ranges::begin(candidates))) {
  for (const auto& candidate : candidates) {
    if (!isAnotherPose(poseOf(candidate), best, other_rotation_rad)) continue;
    auto refined = refine(candidate);
    if (refined && isAnotherPose(poseOf(*refined), best, other_rotation_rad)) return refined;
  }
  return std::nullopt;
}

}  // namespace waymark::slam
