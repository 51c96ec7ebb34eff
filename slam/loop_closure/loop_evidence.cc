#include "slam/loop_closure/loop_evidence.h"

#include <utility>

namespace waymark::slam {

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
  } else if (loop.size() == 1) {
    const auto square =
        estimateSquarePose(*loop[0].detection, loop[0].size_m, focal_px, options.square);
    if (!square) return evidence;
    add(loop[0]);
    for (const Transform& T_c_m : square->T_c_m) {
      evidence.expected.push_back(loop[0].T_w_m * T_c_m.inverse());
    }
  }
  evidence.frame.detections.change([](auto* detections) { sortById(detections); });
  return evidence;
}

}  // namespace waymark::slam
