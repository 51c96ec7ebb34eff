// Local and global optimization of the map (seed 1, sections 4.7 and 4.10).
#pragma once

#include "base/task.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam {

// A part of the map; its keyframes and markers as they are now. The map and the options must
// outlive the task.
Task<MapCorrection> optimizeSubproblem(const Map& map, SubproblemMembers roles,
                                       const MarkerOptions& markers, BundleOptions options,
                                       Budget* budget);

// Puts an optimization of the whole map that is done into it. What that did to the newest keyframe
// taken part: T_new_old; empty when nothing has changed. All coordinates are others then.
std::optional<Transform> applyWhole(const MapCorrection& correction, Map* map);

// Section 4.7, at once. Precondition: the keyframe exists.
BundleSummary optimizeLocally(Map* map, KeyframeId keyframe, const MarkerOptions& markers,
                              const BundleOptions& options);
// Section 4.10, at once: all keyframes and all posed markers. Views that turn out to be gross leave
// the map (BundleOptions::view_chi2).
BundleSummary optimizeGlobally(Map* map, const MarkerOptions& markers,
                               const BundleOptions& options);

// Of one marker, given the keyframes that see it: its views as they are, none left out. Empty where
// there is no optimum. Precondition: it has a pose.
[[nodiscard]] std::optional<Transform> optimizeMarker(const Map& map, int marker_id,
                                                      const BundleOptions& options);

// Of (dp, dtheta) of a marker at T_w_m, given the keyframes that see it and the noise of their
// whitened residuals. Zero for one that nobody sees. Precondition: the map knows it.
[[nodiscard]] Matrix6d markerCovariance(const Map& map, int marker_id, const Transform& T_w_m,
                                        double residual_sigma);

}  // namespace waymark::slam
