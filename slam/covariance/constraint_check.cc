#include "slam/covariance/constraint_check.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <functional>
#include <iterator>

#include "slam/covariance/marginal_recovery.h"
#include "slam/optimization/map_fit.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam {
namespace {

std::string whatOf(const ConstraintSource& source, const MarkerOptions& options) {
  const MarkerConstraints& constraints = options.constraints;
  switch (source.kind) {
    case ConstraintSource::Kind::kAnchor:
      return "from where its anchor has it";
    case ConstraintSource::Kind::kAnchorTurn:
      return "from how its anchor has it turned";
    case ConstraintSource::Kind::kPosition:
      return "from its position";
    case ConstraintSource::Kind::kPlane:
      return "from " + planeName(constraints, source.index);
    case ConstraintSource::Kind::kPlaneTilt:
      return "tilted against " + planeName(constraints, source.index);
    case ConstraintSource::Kind::kLevel:
      return "from the vertical as part of " + planeName(constraints, source.index);
    case ConstraintSource::Kind::kUpright:
      return "from upright";
    case ConstraintSource::Kind::kDistance:
      return "from " + distanceName(constraints.distances[source.index]);
  }
  return {};
}

}  // namespace

std::vector<ConstraintResidual> constraintResiduals(const Map& map, const MarkerOptions& options) {
  if (options.constraints.empty() && options.anchors.empty()) return {};
  const Subproblem whole =
      runToCompletion([&](Budget* a) { return buildSubproblem(map, wholeMap(map), options, a); });
  const double residual_sigma =
      runToCompletion([&](Budget* a) { return fitOf(whole.problem, a); }).residual_sigma;
  const CameraUncertainty known{};
  std::vector<ConstraintResidual> residuals;
  (void)runToCompletion([&](Budget* a) {
    return recoverMarginals(map, options, known, residual_sigma, a, nullptr, &residuals);
  });
  return residuals;
}

std::string constraintText(const ConstraintResidual& residual, const MarkerOptions& options) {
  std::array<char, 32> sigmas{};
  (void)std::snprintf(sigmas.data(), sigmas.size(), "%.1f", residual.sigmas);
  return "marker " + std::to_string(residual.source.marker) + ": " + sigmas.data() + " sigmas " +
         whatOf(residual.source, options);
}

std::vector<ConstraintResidual> contradictions(const std::vector<const Map*>& pieces,
                                               const MarkerOptions& options) {
  std::vector<ConstraintResidual> found;
  for (const Map* const piece : pieces) {
    std::ranges::copy_if(constraintResiduals(*piece, options), std::back_inserter(found),
                         [&](const ConstraintResidual& residual) {
                           return residual.sigmas > options.constraints.gate_sigmas;
                         });
  }
  std::ranges::stable_sort(found, std::greater(), &ConstraintResidual::sigmas);
  return found;
}

std::vector<std::string> contradictionLines(const std::vector<ConstraintResidual>& found,
                                            const MarkerOptions& options) {
  constexpr std::size_t kMost = 10;
  std::vector<std::string> lines;
  for (const ConstraintResidual& residual : found) {
    if (lines.size() == kMost) {
      lines.push_back("and " + std::to_string(found.size() - kMost) + " more such contradictions");
      break;
    }
    lines.push_back(constraintText(residual, options));
  }
  return lines;
}

}  // namespace waymark::slam
