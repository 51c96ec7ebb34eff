#include "slam/pose_by_picture.h"

#include "slam/covariance/seen_through.h"
#include "slam/geometry/turned_covariance.h"

namespace waymark::slam {
namespace {

double positionVariance(const PoseEstimate& pose) {
  return pose.view_covariance.topLeftCorner<3, 3>().trace();
}

}  // namespace

std::optional<PoseByPicture> poseByPicture(std::span<const LateResult> found, std::int64_t time_ns,
                                           const CameraUncertainty& camera, const Map& map) {
  std::optional<PoseByPicture> best;
  for (const LateResult& one : found) {
    const MapMarker* const picture = map.findPosed(one.landmark);
    if (picture == nullptr || !one.decided) continue;
    const SeenThrough frame{
        .found_with = *camera.camera, .by_now = camera, .monotonic_ns = time_ns};
    const auto seen =
        seenThrough(frame, {one.T_m_c, one.covariance}, picture->size_m, picture->height_m);
    if (!seen) continue;
    const Transform& T_w_p = *picture->T_w_m;
    PoseEstimate pose;
    pose.T_w_c = T_w_p * seen->T_m_c;
    pose.covariance = pose.view_covariance = turnedCovariance(T_w_p.R, seen->covariance);
    pose.source = PoseSource::kNaturalFeatures;
    pose.ambiguity_ratio = one.ambiguity_ratio;
    if (best && positionVariance(best->pose) <= positionVariance(pose)) continue;
    best = {pose, picture->id};
  }
  return best;
}

}  // namespace waymark::slam
