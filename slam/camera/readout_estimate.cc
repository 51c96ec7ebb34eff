#include "slam/camera/readout_estimate.h"

#include <cmath>
#include <utility>

#include "slam/camera/rolling_shutter.h"

namespace waymark::slam {

BundleOptions ungated(BundleOptions options) {
  options.view_chi2 = 0.0;
  return options;
}

void freeReadout(const Map& map, double readout_s, const CameraModel& camera, Subproblem* part) {
  BundleProblem& problem = part->problem;
  BundleProblem::Shutter shutter;
  shutter.readout_s = shutter.corrected_with_s = readout_s;
  for (const auto& observation : problem.observations) {
    const auto c = static_cast<std::size_t>(observation.camera);
    const auto m = static_cast<std::size_t>(observation.marker);
    const auto keyframe = map.keyframes().find(part->keyframes[c]);
    const Vector6d twist =
        keyframe != map.keyframes().end() ? keyframe->second.twist : Vector6d(Vector6d::Zero());
    const Transform T_c_w = problem.cameras[c].T.inverse();
    const auto corners = markerCorners(problem.marker_sizes_m[m]);
    auto& motion = shutter.motion.emplace_back();
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d p_c = T_c_w * (problem.markers[m].T * corners[k]);
      motion[k] = rowTime(observation.detection->pixels[k].y(), camera.height()) *
                  imageVelocity(p_c, twist);
    }
  }
  problem.shutter = std::move(shutter);
}

Task<std::optional<ReadoutEstimate>> estimateReadout(const Map& map, const MarkerOptions& markers,
                                                     double readout_s, const CameraModel& camera,
                                                     int keyframes, BundleOptions options,
                                                     Budget* budget) {
  Subproblem newest = co_await buildSubproblem(map, newestMap(map, keyframes), markers, budget);
  freeReadout(map, readout_s, camera, &newest);
  BundleAdjuster adjuster(std::move(newest.problem), options);
  const BundleSummary summary = co_await adjuster.run(budget);
  const std::optional<GlobalMatrix> covariance = co_await adjuster.globalsCovariance(budget);
  if (summary.failed || !covariance || !((*covariance)(9, 9) > 0.0)) co_return std::nullopt;
  co_return ReadoutEstimate{adjuster.problem().shutter->readout_s, std::sqrt((*covariance)(9, 9))};
}

}  // namespace waymark::slam
