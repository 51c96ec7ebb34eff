#include "slam/initialization/one_frame.h"

namespace waymark::slam {

std::vector<InitialMarker> initializeFromOneFrame(std::span<const MarkerDetection> detections,
                                                  const MarkerOptions& markers, double focal_px,
                                                  double tau_e, const SquarePoseOptions& square) {
  std::vector<InitialMarker> initial;
  for (const MarkerDetection& detection : detections) {
    const auto pose = estimateSquarePose(detection, markers.sizeOf(detection.id), focal_px, square);
    if (pose && pose->unambiguous(tau_e)) {
      initial.push_back({detection.id, pose->T_c_m[0], pose->T_c_m[1]});
    }
  }
  return initial;
}

}  // namespace waymark::slam
