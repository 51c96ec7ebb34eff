#include "slam/initialisation/one_frame.h"

namespace waymark::slam {

std::vector<InitialMarker> initialiseFromOneFrame(std::span<const MarkerDetection> detections,
                                                  double marker_size_m, double focal_px,
                                                  const InitialisationOptions& options) {
  std::vector<InitialMarker> markers;
  for (const MarkerDetection& detection : detections) {
    const auto pose = estimateSquarePose(detection, marker_size_m, focal_px, options.square);
    if (pose && pose->unambiguous(options.ambiguity_ratio)) {
      markers.push_back({detection.id, pose->T_c_m[0]});
    }
  }
  return markers;
}

}  // namespace waymark::slam
