// The readout time of a rolling shutter among the unknowns of an optimization.
#pragma once

#include <optional>

#include "base/task.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/bundle_adjuster.h"
#include "slam/optimization/subproblem.h"

namespace waymark::slam {

// Nobody is left out while shutter or lens are not known well: the views that speak loudest of them
// fit worst.
[[nodiscard]] BundleOptions ungated(BundleOptions options);

// The readout time becomes an unknown of the part, whose corners were corrected with readout_s:
// where they would have moved with another one.
void freeReadout(const Map& map, double readout_s, const CameraModel& camera, Subproblem* part);

// What it most likely is, given the newest keyframes, and how well that is known.
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

}  // namespace waymark::slam
