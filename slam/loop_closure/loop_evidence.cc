#include "slam/loop_closure/loop_evidence.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace waymark::slam {
namespace {

// The two cameras of the square; empty where its corners give none.
std::vector<Transform> camerasOf(const KnownMarker& marker, double focal_px,
                                 const SquarePoseOptions& options) {
  const auto square = estimateSquarePose(*marker.detection, marker.size_m, focal_px, options);
  if (!square) return {};
  return {marker.T_w_m * square->T_c_m[0].inverse(), marker.T_w_m * square->T_c_m[1].inverse()};
}

// Where only one marker says where the frame is, by the better of its two poses, and the other one
// is nearer to where the frame was tracked, it may be that: the map may know the marker less well
// than the ratio of two errors supposes, and drift is small beside what is between the two.
bool otherIsNearer(const std::vector<Transform>& cameras, const Transform& expected,
                   const Transform& tracked) {
  const auto away = [&](const Transform& T) { return (T.p - tracked.p).norm(); };
  return std::ranges::any_of(cameras,
                             [&](const Transform& T) { return away(T) < 0.5 * away(expected); });
}

}  // namespace

LoopFrame loopEvidence(Keyframe frame, KeyframeId reference, std::span<const KnownMarker> loop,
                       const PoseOptimizer& optimizer, double focal_px,
                       const RelocalizerOptions& options) {
  LoopFrame evidence{std::move(frame), {}, {}, reference};
  const auto add = [&](const KnownMarker& marker) {
    evidence.loop_markers.push_back(marker.detection->id);
    evidence.frame.detections.push_back(*marker.detection);
  };
  const auto expected = relocalize(loop, optimizer, focal_px, options);
  if (expected && optimizer.acceptable(*expected)) {
    for (std::size_t i = 0; i < loop.size(); ++i) {
      if (expected->inlier[i]) add(loop[i]);
    }
    evidence.expected = {expected->T_w_c};
    if (loop.size() == 1) {
      const auto cameras = camerasOf(loop[0], focal_px, options.square);
      const Transform& T_w_c = evidence.frame.T_w_c;
      if (otherIsNearer(cameras, expected->T_w_c, T_w_c)) evidence.expected = cameras;
    }
  } else if (loop.size() == 1) {
    evidence.expected = camerasOf(loop[0], focal_px, options.square);
    if (!evidence.expected.empty()) add(loop[0]);
  }
  evidence.frame.detections.change([](auto* detections) { sortById(detections); });
  return evidence;
}

}  // namespace waymark::slam
