// Local and global optimization of the map (seed 1, sections 4.7 and 4.10).
#pragma once

#include <optional>
#include <string>

#include "base/task.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam {

// How well a calibration is known, as sigmas; 0 keeps a parameter fixed.
struct IntrinsicPriors {
  double focal_px = 3.0;
  double centre_px = 3.0;
  double distortion = 0.01;  // of every coefficient

  [[nodiscard]] IntrinsicVector sigmas() const;
  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// A part of the map; its keyframes and markers as they are now. The map and the options must
// outlive the task.
Task<MapCorrection> optimizeSubproblem(const Map& map, SubproblemMembers roles,
                                       const MarkerOptions& markers, BundleOptions options,
                                       Budget* budget);

// Section 4.7, at once. Precondition: the keyframe exists.
BundleSummary optimizeLocally(Map* map, KeyframeId keyframe, const MarkerOptions& markers,
                              const BundleOptions& options);
// Section 4.10, at once: all keyframes and all posed markers. Views that turn out to be gross leave
// the map (BundleOptions::view_chi2).
BundleSummary optimizeGlobally(Map* map, const MarkerOptions& markers,
                               const BundleOptions& options);
// The same with the intrinsics as unknowns (Eq. 41), expected where the calibration has them. On
// success *camera, which undistorted the map's corners, is the better lens, and undistorts them
// anew.
BundleSummary optimizeGloballyWithIntrinsics(Map* map, const MarkerOptions& markers,
                                             const IntrinsicVector& expected,
                                             const IntrinsicPriors& priors, double readout_s,
                                             const BundleOptions& options, CameraModel* camera);

// The readout time among the unknowns: what it most likely is, given the newest keyframes, and how
// well that is known.
struct ReadoutEstimate {
  double readout_s = 0.0;
  double sigma_s = 0.0;
};
// The map's corners are corrected with readout_s; the map stays as it is. keyframes: how many take
// part at most. Empty when nothing in them depends on it (a camera that hardly moved). What is
// given must outlive the task.
Task<std::optional<ReadoutEstimate>> estimateReadout(const Map& map, const MarkerOptions& markers,
                                                     double readout_s, const CameraModel& camera,
                                                     int keyframes, BundleOptions options,
                                                     Budget* budget);

// Of (dp, dtheta) of a marker's pose, given the keyframes that see it and the noise of their
// whitened residuals. Zero for one that nobody sees. Precondition: it has a pose.
[[nodiscard]] Matrix6d markerCovariance(const Map& map, int marker_id, double residual_sigma);

}  // namespace waymark::slam
