// The pose of a marker seen ambiguously in several keyframes of known pose (seed 1, section 4.5).
#pragma once

#include <optional>
#include <span>
#include <string>

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
  // From this turn on an orientation is another one, radians: more than noise moves a refined pose,
  // less than what a marker's two solutions differ by.
  double other_rotation_rad = 0.05;
  // From this ratio on the other orientation is forgotten; below it a resolved marker is looked at
  // again with every new keyframe. Larger keeps a wrong choice curable for longer and costs time.
  double final_ratio = 20.0;
  // Largest acceptable mean chi-square per view of the best pose (8 residuals each), in units of
  // the map's noise. Above it the views contradict each other: the marker moved between them, or
  // its size is wrong.
  double max_chi2_per_view = 200.0;
  // Of a pose over all views, at most. More come nearer to the minimum and cost time.
  int refinement_iterations = 8;
  SquarePoseOptions square;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

struct MarkerView {
  const MarkerDetection* detection = nullptr;
  Transform T_w_c;
};

enum class ResolverVerdict {
  kTooFewViews,
  kUndecided,      // two poses explain the views about equally well
  kContradictory,  // no pose explains the views
  kResolved,
};

struct MarkerResolution {
  ResolverVerdict verdict = ResolverVerdict::kTooFewViews;
  Transform T_w_m;                       // the best pose; meaningful unless kTooFewViews
  std::optional<Transform> other_T_w_m;  // the best of another orientation, where one is left
  std::size_t worst_view = 0;            // the one that the best pose explains least
  double ratio = 1.0;                    // how much better the best one explains the views
};

// Eq. 24-27: of the two solutions of each view, the one that minimizes the reprojection error in
// all of them, refined over all views. noise: standard deviation of the map's whitened residuals.
[[nodiscard]] MarkerResolution resolveMarkerPose(std::span<const MarkerView> views, double size_m,
                                                 double focal_px, double residual_sigma,
                                                 const MarkerResolverOptions& options = {});

}  // namespace waymark::slam
