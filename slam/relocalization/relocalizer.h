// The camera pose without any prior, from the markers in view (seed 1, section 4.8).
#pragma once

#include <optional>
#include <span>

#include "slam/camera_pose/pose_optimizer.h"
#include "slam/marker_pose/square_pose.h"

namespace waymark::slam {

struct RelocalizerOptions {
  // A single marker must be at least this unambiguous (tau_e), and several of them must explain
  // the image this many times better from here than from anywhere else.
  double ambiguity_ratio = 3.0;
  // Anywhere else: turned by this much, radians. Without a prior even the right pose is refined
  // from poor starts that end a little apart; a planar marker's two solutions differ by far more.
  double other_rotation_rad = 0.1;
  SquarePoseOptions square;
};

// Eq. 34: every marker's two solutions propose a camera pose; the one that explains all markers
// best is refined. Empty when one ambiguous marker is all there is, when another pose explains the
// markers about as well, or when nothing fits.
[[nodiscard]] std::optional<PoseSolution> relocalize(std::span<const KnownMarker> markers,
                                                     const PoseOptimizer& optimizer,
                                                     double focal_px,
                                                     const RelocalizerOptions& options = {});

}  // namespace waymark::slam
