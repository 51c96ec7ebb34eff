#include "slam/marker_pose/marker_resolver.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/reprojection.h"
#include "slam/geometry/two_hypotheses.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// A view with what does not change from pose to pose.
struct WhitenedView {
  const MarkerView* view = nullptr;
  WhitenedCorners W;
};

std::vector<WhitenedView> whiten(std::span<const MarkerView> views) {
  std::vector<WhitenedView> whitened;
  whitened.reserve(views.size());
  for (const MarkerView& view : views) {
    whitened.push_back({&view, whitening(view.detection->covariance)});
  }
  return whitened;
}

// Eq. 26 alone: whitened, of all views; infinite when a corner is not in front of a camera.
double costOf(const Transform& T_w_m, std::span<const WhitenedView> views, double size_m) {
  const auto corners = markerCorners(size_m);
  double cost = 0.0;
  for (const WhitenedView& whitened : views) {
    for (std::size_t k = 0; k < 4; ++k) {
      const auto squared = squaredError(whitened.view->T_w_c, T_w_m * corners[k],
                                        whitened.view->detection->normalized[k], whitened.W[k]);
      if (!squared) return std::numeric_limits<double>::infinity();
      cost += *squared;
    }
  }
  return cost;
}

// False when a corner is not in front of a camera.
bool linearize(const Transform& T_w_m, std::span<const WhitenedView> views, double size_m,
               PoseNormal* normal) {
  const auto corners = markerCorners(size_m);
  for (const WhitenedView& whitened : views) {
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d p = T_w_m * corners[k];
      Projection projection;
      if (!projectPoint(whitened.view->T_w_c, p, &projection)) return false;
      const Eigen::Matrix2d& W = whitened.W[k];
      const Eigen::Vector2d r =
          W * (projection.normalized - whitened.view->detection->normalized[k]);
      const Matrix26d J = W * markerJacobian(T_w_m, p, projection.J_point);
      normal->cost += r.squaredNorm();
      normal->H += J.transpose() * J;
      normal->g += J.transpose() * r;
    }
  }
  return true;
}

struct Candidate {
  Transform T_w_m;
  double cost;
};

Candidate refine(const Candidate& candidate, std::span<const WhitenedView> views, double size_m,
                 int iterations) {
  const auto refined =
      minimizePose(candidate.T_w_m, iterations, [&](const Transform& T_w_m, PoseNormal* normal) {
        return linearize(T_w_m, views, size_m, normal);
      });
  return refined ? Candidate{refined->T, refined->normal.cost} : candidate;
}

// Theta_m of Eq. 24, in the world, the best first.
std::vector<Candidate> proposePoses(std::span<const WhitenedView> views, double size_m,
                                    double focal_px, const SquarePoseOptions& options) {
  std::vector<Candidate> candidates;
  for (const WhitenedView& whitened : views) {
    const MarkerView& view = *whitened.view;
    const auto pose = estimateSquarePose(*view.detection, size_m, focal_px, options);
    if (!pose) continue;
    for (const Transform& T_c_m : pose->T_c_m) {
      const Transform T_w_m = view.T_w_c * T_c_m;
      const double cost = costOf(T_w_m, views, size_m);
      if (std::isfinite(cost)) candidates.push_back({T_w_m, cost});
    }
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.cost < b.cost; });
  return candidates;
}

std::size_t worstView(const Transform& T_w_m, std::span<const WhitenedView> views, double size_m) {
  std::size_t worst = 0;
  double highest = 0.0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const double cost = costOf(T_w_m, views.subspan(i, 1), size_m);
    if (cost <= highest) continue;
    highest = cost;
    worst = i;
  }
  return worst;
}

double meanCornerVariance(std::span<const MarkerView> views) {
  double variance = 0.0;
  for (const MarkerView& view : views) variance += cornerVariance(*view.detection);
  return variance / static_cast<double>(views.size());
}

}  // namespace

std::string MarkerResolverOptions::invalidReason() const {
  return firstReason({
      firstUnmet({
          {min_views >= 2, "a marker needs at least 2 views to be resolved"},
          {ambiguity_ratio >= 1.0 && final_ratio >= 1.0, "ambiguity ratios must be at least 1"},
          {isNotNegative(other_rotation_rad), "the turn to another pose must not be negative"},
          {isPositive(max_chi2_per_view), "the chi-square of a view must be positive"},
          {refinement_iterations >= 1, "a marker's pose needs at least 1 iteration"},
      }),
      square.invalidReason(),
  });
}

MarkerResolution resolveMarkerPose(std::span<const MarkerView> views, double size_m,
                                   double focal_px, double residual_sigma,
                                   const MarkerResolverOptions& options) {
  MarkerResolution resolution;
  if (static_cast<int>(views.size()) < options.min_views) return resolution;
  const std::vector<WhitenedView> whitened = whiten(views);
  const std::vector<Candidate> candidates =
      proposePoses(whitened, size_m, focal_px, options.square);
  if (candidates.empty()) {
    resolution.verdict = ResolverVerdict::kContradictory;
    return resolution;
  }
  // The best pose, and the best one that stays another pose after refinement.
  const auto refined = [&](const Candidate& candidate) {
    return refine(candidate, whitened, size_m, options.refinement_iterations);
  };
  const Candidate best = refined(candidates.front());
  resolution.T_w_m = best.T_w_m;
  const auto other = otherHypothesis(
      candidates, best.T_w_m, options.other_rotation_rad,
      [&](const Candidate& rival) { return std::optional(refined(rival)); },
      [](const Candidate& candidate) { return candidate.T_w_m; });
  if (other) resolution.other_T_w_m = other->T_w_m;
  const double other_cost = other ? other->cost : std::numeric_limits<double>::infinity();
  const double n = static_cast<double>(views.size());
  if (!(best.cost <= options.max_chi2_per_view * residual_sigma * residual_sigma * n)) {
    resolution.verdict = ResolverVerdict::kContradictory;
    resolution.worst_view = worstView(best.T_w_m, whitened, size_m);
    return resolution;
  }
  const double floor = comparisonFloor(meanCornerVariance(views), focal_px,
                                       static_cast<int>(views.size()), options.square);
  resolution.ratio = (other_cost + floor) / (best.cost + floor);
  resolution.verdict = resolution.ratio < options.ambiguity_ratio ? ResolverVerdict::kUndecided
                                                                  : ResolverVerdict::kResolved;
  if (resolution.ratio >= options.final_ratio) resolution.other_T_w_m.reset();
  return resolution;
}

}  // namespace waymark::slam
