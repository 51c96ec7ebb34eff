// The camera pose without any prior, from the markers in view (seed 1, section 4.8).
#pragma once

#include <optional>
#include <span>

#include "slam/marker_pose/square_pose.h"
#include "slam/tracking/pose_optimiser.h"

namespace waymark::slam {

struct RelocaliserOptions {
  // A single marker must be at least this unambiguous (tau_e).
  double ambiguity_ratio = 3.0;
  SquarePoseOptions square;
};

struct Relocalisation {
  PoseSolution solution;
  // Error of the best hypothesis of another pose over that of the chosen one.
  double ambiguity_ratio = 1.0;
};

// Eq. 34: every marker's two solutions propose a camera pose; the one that explains all markers
// best is refined. Empty when one ambiguous marker is all there is, or nothing fits. sizes_m: side
// of each observation's marker; T_w_m: its pose in the map.
struct KnownMarker {
  PoseObservation observation;
  Transform T_w_m;
  double size_m = 0.0;
};
[[nodiscard]] std::optional<Relocalisation> relocalise(std::span<const KnownMarker> markers,
                                                       const PoseOptimiser& optimiser,
                                                       double focal_px,
                                                       const RelocaliserOptions& options = {});

}  // namespace waymark::slam
