// Two-frame initialization (seed 1, section 4.1.2): a start from ambiguous markers only.
#pragma once

#include <span>
#include <string>
#include <variant>
#include <vector>

#include "slam/initialization/one_frame.h"
#include "slam/optimization/bundle_adjuster.h"

namespace waymark::slam {

struct TwoFrameOptions {
  // tau_bl: least baseline between the two frames, metres, and as a share of the distance to the
  // markers; the larger one counts. Too short a baseline cannot tell the two solutions apart.
  double min_baseline_m = 0.007;
  double min_baseline_per_depth = 0.05;
  // Largest mean chi-square of a marker in both frames (16 residuals; 5 or so unknowns a marker).
  double worst_chi2_per_marker = 200.0;
  // The motion between the frames must explain them this many times better than any motion that
  // turns the camera elsewhere, and each marker's pose than its other one (tau_e).
  double ambiguity_ratio = 3.0;
  // What counts as turned elsewhere, radians: more than noise moves a refined motion, less than
  // what a marker's two solutions differ by.
  double other_rotation_rad = 0.05;
  // Of a motion together with the markers' poses: a few corners in two frames, whose covariances
  // are all that is known of their noise.
  BundleOptions refinement{.max_iterations = 10, .estimate_residual_sigma = false};
  SquarePoseOptions square;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct TwoFrameStart {
  Transform T_0_1;                     // the second camera in the first one, the world
  std::vector<InitialMarker> markers;  // those whose pose is decided
};

enum class TwoFrameFailure { kNoCommonMarker, kShortBaseline, kAmbiguous, kPoorFit };

// Eq. 15-20. `first` and `second`: detections sorted by id.
[[nodiscard]] std::variant<TwoFrameStart, TwoFrameFailure> initializeFromTwoFrames(
    std::span<const MarkerDetection> first, std::span<const MarkerDetection> second,
    const MarkerOptions& markers, double focal_px, const TwoFrameOptions& options);

}  // namespace waymark::slam
