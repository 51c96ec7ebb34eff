// The pose of a marker seen ambiguously in several keyframes of known pose (seed 1, section 4.5).
#pragma once

#include <optional>
#include <span>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/transform.h"
#include "slam/marker_pose/square_pose.h"

namespace waymark::slam {

struct MarkerResolverOptions {
  // Keyframes a marker must be seen in; the paper's experience says three.
  int min_views = 3;
  // The best of the 2n candidates must explain the views this many times better than the best one
  // of the other orientation (tau_e).
  double ambiguity_ratio = 3.0;
  // Largest acceptable mean chi-square per view of the best pose (8 residuals each).
  double worst_chi2_per_view = 200.0;
  SquarePoseOptions square;
};

struct MarkerView {
  const MarkerDetection* detection = nullptr;
  Transform T_w_c;
};

// Eq. 24-27: of the two solutions of each view, the one that minimises the reprojection error in
// all of them, refined over all views. Empty while the evidence does not decide.
[[nodiscard]] std::optional<Transform> resolveMarkerPose(std::span<const MarkerView> views,
                                                         double size_m, double focal_px,
                                                         const MarkerResolverOptions& options = {});

}  // namespace waymark::slam
