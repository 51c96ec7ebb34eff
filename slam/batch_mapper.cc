#include "slam/batch_mapper.h"

#include "slam/camera/lens_model.h"
#include "slam/covariance/marginals.h"
#include "slam/covariance/pose_by_camera.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/optimization/map_optimizer.h"
#include "slam/pose_by_picture.h"

namespace waymark::slam {

BatchMapper::BatchMapper(const BatchMapperParts& parts)
    : with_(parts),
      last_old_keyframe_(parts.map->keyframes().empty() ? -1
                                                        : parts.map->keyframes().rbegin()->first),
      locator_(parts.screening, *parts.camera, parts.rolling_shutter, parts.tracker) {}

bool BatchMapper::hasMapToOptimize() const {
  return with_.options.mapping && !with_.map->keyframes().empty();
}

void BatchMapper::recoverCovariance() {
  with_.covariance->recover(with_.updater->residualSigma(), with_.map);
}

void BatchMapper::densify(std::span<const RecordedFrame> frames) {
  if (!with_.options.mapping) return;
  locator_.densify(frames, last_old_keyframe_, with_.map);
  with_.updater->resolveAll(with_.map);
}

void BatchMapper::optimize() {
  if (!hasMapToOptimize()) return;
  const BundleSummary summary =
      optimizeGlobally(with_.map, with_.options.markers, with_.options.global_optimization);
  with_.covariance->recover(summary.residual_sigma, with_.map);
}

// One that turned out to be another is held less.
ExpectedLens BatchMapper::expectedLens() const {
  const LensPrior& prior = with_.options.lens.prior;
  const CameraModel given = prior.expectedGiven(
      expectedAs(with_.lens.given, with_.options.lens.given, *with_.camera), *with_.camera);
  const bool as_given = with_.lens.state == LensState::kGiven && !given.calibration().covariance;
  return {given.intrinsics(),
          as_given ? with_.options.intrinsics.covariance() : prior.covariance(given)};
}

void BatchMapper::optimizeWithIntrinsics() {
  if (!hasMapToOptimize()) return;
  (void)optimizeGloballyWithIntrinsics(with_.map, with_.options.markers, expectedLens(),
                                       with_.rolling_shutter.seconds(),
                                       with_.options.global_optimization, with_.camera);
  recoverCovariance();
}

PoseEstimate BatchMapper::estimateOf(const std::vector<KnownMarker>& known,
                                     const RecordedFrame& frame, PoseSolution* solution) const {
  const double sigma = with_.updater->residualSigma();
  solution->widenTo(sigma * sigma);
  PoseEstimate estimate = with_.tracker.estimateOf(*solution, known, frame.twist);
  const PoseGlobalMatrix in_view =
      poseByCamera(*solution, known, with_.uncertainty, frame.twist, frame.monotonic_ns);
  estimate.covariance = with_.covariance->inWorld(*solution, known, in_view);
  estimate.view_covariance += covarianceByCamera(with_.uncertainty, in_view);
  return estimate;
}

std::optional<PoseEstimate> BatchMapper::localize(const RecordedFrame& frame) const {
  auto located = locator_.locate(*with_.map, frame);
  if (!located) return localizeByPicture(frame);
  return estimateOf(located->known, frame, &located->solution);
}

// Not once the lens is another one than the one that the picture was found through.
std::optional<PoseEstimate> BatchMapper::localizeByPicture(const RecordedFrame& frame) const {
  if (frame.found.empty() || with_.lens.changes > 0) return std::nullopt;
  auto by_picture = poseByPicture(frame.found, frame.monotonic_ns, with_.uncertainty, *with_.map);
  if (!by_picture) return std::nullopt;
  PoseEstimate& pose = by_picture->pose;
  const MapMarker& picture = *with_.map->findPosed(by_picture->picture);
  const Matrix6d T = rigidTransport(pose.T_w_c.p - picture.T_w_m->p);
  pose.covariance += T * picture.world_covariance * T.transpose();
  return pose;
}

std::optional<PosesOfOneMarker> BatchMapper::localizeByOneMarker(const RecordedFrame& frame) const {
  auto located =
      locator_.locateByOneMarker(*with_.map, frame, with_.options.tracking.relocalization.square);
  if (!located) return std::nullopt;
  PosesOfOneMarker both{
      located->known.front().detection->id, {}, located->view.log_odds, located->view.barrier};
  for (std::size_t i = 0; i < 2; ++i) {
    both.poses[i] = estimateOf(located->known, frame, &located->solutions[i]);
  }
  return both;
}

}  // namespace waymark::slam
