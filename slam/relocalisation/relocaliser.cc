#include "slam/relocalisation/relocaliser.h"

#include <algorithm>
#include <vector>

namespace waymark::slam {
namespace {

// Squared errors are cut off per marker, so that one that moved cannot outvote the others.
constexpr double kCutChi2 = 400.0;

double truncatedCost(std::span<const KnownMarker> markers, const Transform& T_w_c) {
  double cost = 0.0;
  for (const KnownMarker& marker : markers) {
    const auto chi2 = PoseOptimiser::markerChi2(marker.observation, T_w_c);
    cost += chi2 ? std::min(*chi2, kCutChi2) : kCutChi2;
  }
  return cost;
}

}  // namespace

std::optional<Relocalisation> relocalise(std::span<const KnownMarker> markers,
                                         const PoseOptimiser& optimiser, double focal_px,
                                         const RelocaliserOptions& options) {
  if (markers.empty()) return std::nullopt;
  struct Hypothesis {
    Transform T_w_c;
    double cost;
  };
  std::vector<Hypothesis> hypotheses;
  double best_single_ratio = 1.0;
  for (const KnownMarker& marker : markers) {
    const auto pose =
        estimateSquarePose(*marker.observation.detection, marker.size_m, focal_px, options.square);
    if (!pose) continue;
    best_single_ratio = std::max(best_single_ratio, pose->ratio);
    for (const Transform& T_c_m : pose->T_c_m) {
      const Transform T_w_c = marker.T_w_m * T_c_m.inverse();
      hypotheses.push_back({T_w_c, truncatedCost(markers, T_w_c)});
    }
  }
  if (hypotheses.empty()) return std::nullopt;
  if (markers.size() == 1 && best_single_ratio < options.ambiguity_ratio) return std::nullopt;

  const auto best =
      std::min_element(hypotheses.begin(), hypotheses.end(),
                       [](const Hypothesis& a, const Hypothesis& b) { return a.cost < b.cost; });
  std::vector<PoseObservation> observations;
  observations.reserve(markers.size());
  for (const KnownMarker& marker : markers) observations.push_back(marker.observation);
  auto solution = optimiser.optimise(observations, best->T_w_c);
  if (!solution) return std::nullopt;
  // Most of what is seen has to agree.
  if (2 * solution->inliers < static_cast<int>(markers.size())) return std::nullopt;

  Relocalisation result{std::move(*solution), best_single_ratio};
  if (markers.size() > 1) {
    constexpr double kOtherPose = 0.1;  // radians
    const double chosen = truncatedCost(markers, result.solution.T_w_c) + 1.0;
    result.ambiguity_ratio = 1e3;
    for (const Hypothesis& other : hypotheses) {
      if (rotationDistance(other.T_w_c.R, result.solution.T_w_c.R) < kOtherPose) continue;
      result.ambiguity_ratio = std::min(result.ambiguity_ratio, (other.cost + 1.0) / chosen);
    }
  }
  return result;
}

}  // namespace waymark::slam
