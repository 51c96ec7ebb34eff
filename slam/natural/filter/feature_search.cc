#include "slam/natural/filter/feature_search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <Eigen/LU>

namespace waymark::slam {
namespace {

const ImageView& levelOf(const ImageLevels& levels, int level) {
  return levels[static_cast<std::size_t>(level)];
}

// The stretch without the turn: singular values of A from those of A^T A, less one.
double stretchOf(const Eigen::Matrix2d& A) {
  const Eigen::Matrix2d AtA = A.transpose() * A;
  const double half = 0.5 * AtA.trace();
  const double root = std::sqrt(std::max(0.0, half * half - AtA.determinant()));
  return std::max(std::abs(std::sqrt(half + root) - 1.0),
                  std::abs(std::sqrt(std::max(0.0, half - root)) - 1.0));
}

// Where to begin, and at which level.
struct Start {
  Eigen::Vector2d at;
  int level;
};

// Iterations reach two pixels or so: further off, the ellipse is searched, at the size at which it
// is small.
std::optional<Start> startOf(const ImageLevels& levels, const PatchSource& source,
                             const PatchWarp& warp, const ExpectedFeature& expected,
                             const SearchReach& reach, const PatchOptions& options) {
  constexpr double kIterationsReach_px = 2.0;
  constexpr double kLargestSearch_px = 8.0;
  const double reach_px = std::min(reach.sigmas * longestSigma(expected.covariance), reach.max_px);
  if (reach_px <= 1.0) return Start{expected.pixel, 0};
  if (reach_px <= 2.0 * kIterationsReach_px) return Start{expected.pixel, 1};
  const int level = reach_px > 2.0 * kLargestSearch_px ? 2 : 1;
  PatchTemplate patch;
  if (!warpPatch(source, warp, level, &patch)) return std::nullopt;
  const double per_level = 1 << level;
  const Eigen::Matrix2d ellipse =
      reach.sigmas * reach.sigmas / (per_level * per_level) * expected.covariance;
  const auto found =
      searchPatch(levelOf(levels, level), patch, onLevel(expected.pixel, level), ellipse.inverse(),
                  static_cast<int>(std::ceil(reach_px / per_level)), options);
  if (!found) return std::nullopt;
  return Start{fromLevel(*found, level), level};
}

}  // namespace

Eigen::Vector2d onLevel(const Eigen::Vector2d& pixel, int level) {
  const double scale = 1.0 / (1 << level);
  return scale * pixel + 0.5 * (scale - 1.0) * Eigen::Vector2d::Ones();
}

Eigen::Vector2d fromLevel(const Eigen::Vector2d& at, int level) {
  const double scale = 1 << level;
  return scale * at + 0.5 * (scale - 1.0) * Eigen::Vector2d::Ones();
}

double longestSigma(const Eigen::Matrix2d& C) {
  const double half = 0.5 * (C(0, 0) - C(1, 1));
  return std::sqrt(0.5 * C.trace() + std::sqrt(half * half + C(0, 1) * C(0, 1)));
}

std::optional<PatchWarp> warpOf(const FeatureLook& look, double rho,
                                const ExpectedFeature& expected) {
  // How the image now moves with a step in the anchor's image, and how the depth changes with it:
  // on a plane the ray times its inverse depth is linear in the step.
  const Eigen::RowVector2d deeper = rho * look.surface.transpose();
  const Matrix23d& J = expected.J_feature;
  const Eigen::Matrix2d now_from_anchor =
      (J.leftCols<2>() + J.col(2) * deeper) * look.uv_from_pixel;
  const double scale2 = now_from_anchor.determinant();
  constexpr double kLeastScale2 = 0.1;
  if (!(scale2 > kLeastScale2) || !(scale2 < 1.0 / kLeastScale2)) return std::nullopt;
  PatchWarp warp{.anchor_from_now = now_from_anchor.inverse()};
  const Eigen::RowVector2d forward = expected.J_forward.head<2>() + expected.J_forward[2] * deeper;
  warp.bend = (forward * look.uv_from_pixel * warp.anchor_from_now).transpose();
  return warp;
}

std::optional<FoundFeature> findFeature(const ImageLevels& levels, const FeatureLook& look,
                                        double rho, const ExpectedFeature& expected,
                                        const SearchReach& reach, const PatchOptions& options) {
  const auto warp = warpOf(look, rho, expected);
  if (!warp) return std::nullopt;
  const auto start = startOf(levels, look.source, *warp, expected, reach, options);
  if (!start) return std::nullopt;
  // From coarse to fine; the finest that fits is what is measured. Where an image is blurred that
  // may be a coarse one.
  std::optional<FoundFeature> found;
  Eigen::Vector2d at = start->at;
  const double stretch = stretchOf(warp->anchor_from_now.inverse());
  for (int level = start->level; level >= 0; --level) {
    PatchTemplate patch;
    const auto aligned =
        warpPatch(look.source, *warp, level, &patch)
            ? alignPatch(levelOf(levels, level), patch, onLevel(at, level), options)
            : std::nullopt;
    if (!aligned) break;
    at = fromLevel(aligned->at, level);
    const double per_level = 1 << level;
    found = FoundFeature{
        at, per_level * per_level * aligned->covariance,
        per_level * (options.systematic_px + options.systematic_per_stretch_px * stretch), stretch};
  }
  return found;
}

}  // namespace waymark::slam
