#include "slam/camera/lens_optimizer.h"

#include <utility>

#include "slam/camera/undistort_map.h"
#include "slam/optimization/subproblem.h"
#include "slam/option_checks.h"

namespace waymark::slam {

std::string IntrinsicPriors::invalidReason() const {
  return firstUnmet(
      {{isNotNegative(focal_px) && isNotNegative(centre_px) && isNotNegative(distortion),
        "the sigmas of the intrinsics must not be negative"}});
}

IntrinsicMatrix IntrinsicPriors::covariance() const {
  IntrinsicVector sigmas;
  sigmas << focal_px, focal_px, centre_px, centre_px, distortion, distortion, distortion,
      distortion, distortion;
  return sigmas.cwiseAbs2().asDiagonal();
}

BundleSummary optimizeGloballyWithIntrinsics(Map* map, const MarkerOptions& markers,
                                             const ExpectedLens& expected, double readout_s,
                                             const BundleOptions& options, CameraModel* camera) {
  Subproblem part =
      runToCompletion([&](Budget* a) { return buildSubproblem(*map, wholeMap(*map), markers, a); });
  part.problem.lens = {*camera, *camera, expected.intrinsics, expected.covariance};
  BundleAdjuster adjuster(std::move(part.problem), options);
  const BundleSummary summary = runToCompletion([&](Budget* a) { return adjuster.run(a); });
  const MapCorrection correction =
      runToCompletion([&](Budget* a) { return correctionOf(part, adjuster, a); });
  (void)apply(correction, map);
  removeOutliers(correction, map);
  if (summary.failed) return summary;
  *camera = adjuster.problem().lens->camera;
  undistortAgain(*camera, readout_s, map);
  return summary;
}

}  // namespace waymark::slam
