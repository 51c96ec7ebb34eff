#include "slam/camera/lens_evidence.h"

#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "slam/geometry/robust.h"
#include "slam/optimization/normal_equations.h"

namespace waymark::slam {
namespace {

// What a lens takes of the groups' errors for itself.
constexpr double kUnknowns = 9.0;

// As far beyond the other one as this one is before it.
Transform mirrored(const Transform& before, const Transform& middle) {
  return middle.retract(-middle.localCoordinates(before));
}

// Where the way from the lens in use leads through the one that was found.
BundleProblem beyond(const BundleProblem& in_use, const BundleProblem& found) {
  BundleProblem problem = found;
  problem.lens->camera = CameraModel(found.lens->camera.withIntrinsics(
      2.0 * found.lens->camera.intrinsics() - in_use.lens->camera.intrinsics()));
  for (std::size_t i = 0; i < problem.cameras.size(); ++i) {
    problem.cameras[i].T = mirrored(in_use.cameras[i].T, found.cameras[i].T);
  }
  for (std::size_t i = 0; i < problem.markers.size(); ++i) {
    problem.markers[i].T = mirrored(in_use.markers[i].T, found.markers[i].T);
  }
  if (problem.shutter && in_use.shutter) {
    problem.shutter->readout_s = 2.0 * found.shutter->readout_s - in_use.shutter->readout_s;
  }
  return problem;
}

struct GroupCosts {
  std::vector<double> by_marker, by_keyframe;  // zero of those that nothing was seen of
};

// Empty where a corner is not seen.
Task<std::optional<GroupCosts>> costsOf(const BundleProblem& problem, double huber,
                                        Budget* budget) {
  const std::vector<WhitenedView> whitened = co_await whitenViews(problem, budget);
  std::vector<double> squared;
  const bool seen = co_await cornerErrors(problem, whitened, &squared, budget);
  if (!seen) co_return std::nullopt;
  std::optional<GroupCosts> costs(std::in_place);
  costs->by_marker.assign(problem.markers.size(), 0.0);
  costs->by_keyframe.assign(problem.cameras.size(), 0.0);
  for (std::size_t i = 0; i < squared.size(); ++i) {
    const BundleProblem::Observation& observation = problem.observations[i / 4];
    const double cost = huberCost(squared[i], huber);
    costs->by_marker[static_cast<std::size_t>(observation.marker)] += cost;
    costs->by_keyframe[static_cast<std::size_t>(observation.camera)] += cost;
  }
  co_return costs;
}

}  // namespace

double chi2ByGroups(std::span<const double> before, std::span<const double> least,
                    std::span<const double> beyond) {
  // The costs of a group are c + g + h, c and c - g + h: all g together are zero, and h is what the
  // way costs. With independent residuals of variance 1 the squares of g add up to 4 h.
  double cost = 0.0;
  double squared = 0.0;
  double groups = 0.0;
  for (std::size_t i = 0; i < least.size(); ++i) {
    const double g = 0.5 * (before[i] - beyond[i]);
    cost += 0.5 * (before[i] + beyond[i]) - least[i];
    squared += g * g;
    if (least[i] > 0.0) groups += 1.0;
  }
  if (groups <= kUnknowns || !(cost > 0.0)) return 0.0;
  return 4.0 * cost * cost / squared * (1.0 - kUnknowns / groups);
}

Task<LensEvidence> lensEvidence(const BundleProblem& in_use, const BundleProblem& found,
                                double huber, Budget* budget) {
  LensEvidence evidence;
  if (in_use.lens->camera.calibration().model != found.lens->camera.calibration().model) {
    co_return evidence;
  }
  const BundleProblem mirror = beyond(in_use, found);
  const std::optional<GroupCosts> before = co_await costsOf(in_use, huber, budget);
  const std::optional<GroupCosts> least = co_await costsOf(found, huber, budget);
  const std::optional<GroupCosts> after = co_await costsOf(mirror, huber, budget);
  if (!before || !least || !after) co_return evidence;
  evidence.by_marker = chi2ByGroups(before->by_marker, least->by_marker, after->by_marker);
  evidence.by_keyframe = chi2ByGroups(before->by_keyframe, least->by_keyframe, after->by_keyframe);
  co_return evidence;
}

}  // namespace waymark::slam
