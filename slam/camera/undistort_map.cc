#include "slam/camera/undistort_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "slam/camera/rolling_shutter.h"
#include "slam/geometry/polygon.h"

namespace waymark::slam {
namespace {

// Noise is of pixels, and normalized coordinates are longer with a shorter focal length. Moving
// cameras and small changes of a lens leave it as it is.
void scaleNoise(const std::array<Eigen::Vector2d, 4>& before, MarkerDetection* detection) {
  constexpr double kSmall = 0.02;
  const double side = meanSide(before);
  const double scale = side > 0.0 ? meanSide(detection->normalized) / side : 1.0;
  if (std::abs(scale - 1.0) < kSmall) return;
  for (Eigen::Matrix2d& covariance : detection->covariance) covariance *= scale * scale;
  for (Eigen::Vector2f& doubt : detection->readout_doubt) doubt *= static_cast<float>(scale);
}

}  // namespace

void undistortAgain(const CameraModel& camera, std::vector<MarkerDetection>* detections) {
  std::erase_if(*detections, [&](MarkerDetection& detection) {
    const auto before = detection.normalized;
    if (!undistortCorners(camera, &detection)) return true;
    scaleNoise(before, &detection);
    return false;
  });
}

void undistortAgain(const CameraModel& camera, double readout_s, KeyframeId id, Map* map) {
  const Keyframe& keyframe = map->keyframes().at(id);
  std::vector<int> unseen;
  const SharedDetections before = keyframe.detections;
  for (const MarkerDetection& detection : before) {
    const MapMarker& marker = map->markers().at(detection.id);
    auto again = deskewed(detection, camera, keyframe.T_w_c, keyframe.twist, marker.T_w_m,
                          marker.size_m, readout_s);
    if (again) {
      scaleNoise(detection.normalized, &*again);
      map->replaceView(id, *again);
    } else {
      unseen.push_back(detection.id);
    }
  }
  const KeyframeId only[] = {id};
  for (const int marker_id : unseen) map->removeViews(marker_id, only);
}

void doubtReadout(const CameraModel& camera, double sigma_s, KeyframeId id, Map* map) {
  const Keyframe& keyframe = map->keyframes().at(id);
  const SharedDetections before = keyframe.detections;
  for (const MarkerDetection& detection : before) {
    const MapMarker& marker = map->markers().at(detection.id);
    MarkerDetection again = detection;
    doubtReadout(camera, keyframe.T_w_c, keyframe.twist, marker.T_w_m, marker.size_m, sigma_s,
                 &again);
    if (again.readout_doubt != detection.readout_doubt) map->replaceView(id, again);
  }
}

bool isDoubted(const Map& map) {
  return std::ranges::any_of(map.keyframes(), [](const auto& entry) {
    return std::ranges::any_of(entry.second.detections, &MarkerDetection::isDoubted);
  });
}

void trustReadout(Map* map) {
  for (const auto& [id, keyframe] : map->keyframes()) {
    const SharedDetections before = keyframe.detections;
    for (const MarkerDetection& detection : before) {
      if (!detection.isDoubted()) continue;
      MarkerDetection again = detection;
      again.trustReadout();
      map->replaceView(id, again);
    }
  }
}

void seeThroughOne(const CameraModel& in_use, const LensKnowledge& lens, Map* map) {
  for (const auto& [id, keyframe] : map->keyframes()) {
    const CameraModel& seen_with = lens.at(keyframe.monotonic_ns, in_use);
    if (&seen_with == &in_use) continue;
    const SharedDetections before = keyframe.detections;
    for (MarkerDetection detection : before) {
      for (Eigen::Vector2d& pixel : detection.pixels) {
        if (const auto normalized = seen_with.undistort(pixel)) pixel = in_use.distort(*normalized);
      }
      map->replaceView(id, detection);
    }
  }
}

namespace {

// lensAt: of a frame, given its time.
template <typename LensAt>
void undistortSince(std::int64_t since_ns, double readout_s, Map* map, const LensAt& lensAt) {
  map->beginEpoch();
  for (const auto& [id, keyframe] : map->keyframes()) {
    const std::int64_t time_ns = keyframe.monotonic_ns;
    if (time_ns >= since_ns) undistortAgain(lensAt(time_ns), readout_s, id, map);
  }
}

}  // namespace

void undistortAgain(const CameraModel& in_use, const LensKnowledge& lens, std::int64_t since_ns,
                    double readout_s, Map* map) {
  undistortSince(since_ns, readout_s, map, [&](std::int64_t time_ns) -> const CameraModel& {
    return lens.at(time_ns, in_use);
  });
}

void undistortAgain(const CameraModel& camera, double readout_s, Map* map, std::int64_t since_ns) {
  undistortSince(since_ns, readout_s, map,
                 [&](std::int64_t) -> const CameraModel& { return camera; });
}

}  // namespace waymark::slam
