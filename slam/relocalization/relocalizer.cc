#include "slam/relocalization/relocalizer.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "slam/geometry/two_hypotheses.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// Squared errors are cut off per marker.
double truncatedCost(std::span<const KnownMarker> markers, const Transform& T_w_c,
                     double max_marker_chi2) {
  double cost = 0.0;
  for (const KnownMarker& marker : markers) {
    const auto chi2 = PoseOptimizer::markerChi2(marker, T_w_c);
    cost += chi2 ? std::min(*chi2, max_marker_chi2) : max_marker_chi2;
  }
  return cost;
}

struct Hypothesis {
  Transform T_w_c;
  double cost;
};

// Theta^t of section 4.8, the best by Eq. 34 first. Empty when the only marker is ambiguous.
std::vector<Hypothesis> proposePoses(std::span<const KnownMarker> markers, double focal_px,
                                     const RelocalizerOptions& options) {
  std::vector<Hypothesis> hypotheses;
  for (const KnownMarker& marker : markers) {
    const auto pose =
        estimateSquarePose(*marker.detection, marker.size_m, focal_px, options.square);
    if (!pose) continue;
    if (markers.size() == 1 && !pose->unambiguous(options.ambiguity_ratio)) return {};
    for (const Transform& T_c_m : pose->T_c_m) {
      const Transform T_w_c = marker.T_w_m * T_c_m.inverse();
      hypotheses.push_back({T_w_c, truncatedCost(markers, T_w_c, options.max_marker_chi2)});
    }
  }
  std::sort(hypotheses.begin(), hypotheses.end(),
            [](const Hypothesis& a, const Hypothesis& b) { return a.cost < b.cost; });
  return hypotheses;
}

// Whether a pose that is not the solution, once refined, explains the markers about as well.
bool isRivalled(const PoseSolution& solution, std::span<const KnownMarker> markers,
                const std::vector<Hypothesis>& hypotheses, const PoseOptimizer& optimizer,
                const RelocalizerOptions& options) {
  const double floor = options.square.evidence_floor;
  const double cut = options.max_marker_chi2;
  const double chosen = truncatedCost(markers, solution.T_w_c, cut) + floor;
  const auto other = otherHypothesis(
      hypotheses, solution.T_w_c, options.other_rotation_rad,
      [&](const Hypothesis& rival) { return optimizer.optimize(markers, rival.T_w_c); },
      [](const auto& hypothesis) { return hypothesis.T_w_c; });
  if (!other) return false;
  return truncatedCost(markers, other->T_w_c, cut) + floor < options.ambiguity_ratio * chosen;
}

}  // namespace

std::string RelocalizerOptions::invalidReason() const {
  return firstReason({
      firstUnmet({
          {ambiguity_ratio >= 1.0, "ambiguity ratios must be at least 1"},
          {isNotNegative(other_rotation_rad), "the turn to another pose must not be negative"},
          {isPositive(max_marker_chi2), "the largest chi-square of a marker must be positive"},
          {isShare(min_inlier_share), "the share of markers that agree must be from 0 to 1"},
      }),
      square.invalidReason(),
  });
}

std::optional<PoseSolution> relocalize(std::span<const KnownMarker> markers,
                                       const PoseOptimizer& optimizer, double focal_px,
                                       const RelocalizerOptions& options) {
  const std::vector<Hypothesis> hypotheses = proposePoses(markers, focal_px, options);
  if (hypotheses.empty()) return std::nullopt;
  auto solution = optimizer.optimize(markers, hypotheses.front().T_w_c);
  if (!solution) return std::nullopt;
  if (solution->inliers < options.min_inlier_share * static_cast<double>(markers.size())) {
    return std::nullopt;
  }
  if (markers.size() > 1 && isRivalled(*solution, markers, hypotheses, optimizer, options)) {
    return std::nullopt;
  }
  return solution;
}

}  // namespace waymark::slam
