// One-frame initialization (seed 1, section 4.1.1).
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/detection/marker_detection.h"
#include "slam/map/marker_options.h"
#include "slam/marker_pose/square_pose.h"

namespace waymark::slam {

struct InitialMarker {
  int id = -1;
  Transform T_w_m;  // the world is the first frame's camera
  // The second solution, while nothing but one view's error ratio speaks against it.
  std::optional<Transform> other_T_w_m;
};

// Eq. 14: the markers of the frame whose pose is unambiguous; the camera becomes the world's
// origin. Empty when there is none. tau_e: least error ratio.
[[nodiscard]] std::vector<InitialMarker> initializeFromOneFrame(
    std::span<const MarkerDetection> detections, const MarkerOptions& markers, double focal_px,
    double tau_e, const SquarePoseOptions& square);

}  // namespace waymark::slam
