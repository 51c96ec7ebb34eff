// The camera pose without any prior, from the markers in view (seed 1, section 4.8).
#pragma once

#include <optional>
#include <span>
#include <string>

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
  // A marker's chi-square counts up to here when poses are compared, so that one that moved cannot
  // outvote the others: some 15 times the 99.9 % quantile of 8 residuals, as the poses compared are
  // not refined yet. Smaller cannot tell poor poses from bad ones.
  double max_marker_chi2 = 400.0;
  // At least this share of what is seen has to agree. Larger does without a pose where several
  // markers moved, smaller believes a minority.
  double min_inlier_share = 0.5;
  SquarePoseOptions square;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// Eq. 34: every marker's two solutions propose a camera pose; the one that explains all markers
// best is refined. Empty when one ambiguous marker is all there is, when another pose explains the
// markers about as well, or when nothing fits.
[[nodiscard]] std::optional<PoseSolution> relocalize(std::span<const KnownMarker> markers,
                                                     const PoseOptimizer& optimizer,
                                                     double focal_px,
                                                     const RelocalizerOptions& options = {});

}  // namespace waymark::slam
