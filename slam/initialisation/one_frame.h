// One-frame initialisation (seed 1, section 4.1.1).
#pragma once

#include <span>
#include <vector>

#include "slam/detection/marker_detection.h"
#include "slam/marker_pose/square_pose.h"

namespace waymark::slam {

struct InitialisationOptions {
  double ambiguity_ratio = 3.0;  // tau_e of Eq. 14
  SquarePoseOptions square;
};

struct InitialMarker {
  int id = -1;
  Transform T_c_m;
};

// Eq. 14: the markers of the frame whose pose is unambiguous; the camera becomes the world's
// origin. Empty when there is none.
[[nodiscard]] std::vector<InitialMarker> initialiseFromOneFrame(
    std::span<const MarkerDetection> detections, double marker_size_m, double focal_px,
    const InitialisationOptions& options);

}  // namespace waymark::slam
