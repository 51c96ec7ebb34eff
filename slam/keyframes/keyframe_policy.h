// When a frame becomes a keyframe, and which keyframes are let go (seed 1, sections 4.2, 4.4, 4.6).
#pragma once

#include <optional>
#include <span>
#include <string>

#include "slam/map/map.h"

namespace waymark::slam {

struct KeyframeOptions {
  // tau_bl of the paper: least distance between keyframes, metres. The paper's 7 mm suits a sheet
  // of paper; in a room it is the depth that counts, hence the next one.
  double min_baseline_m = 0.007;
  // The same as a share of the median distance to the markers in view: below it a new view
  // triangulates nothing new. Smaller keeps more keyframes and costs time.
  double min_baseline_per_depth = 0.04;
  // Turning this far counts like the baseline above, radians.
  double min_rotation_rad = 0.15;
  // N_c of Eq. 28: keyframes kept per marker.
  int views_per_marker = 12;
  // How far away the markers are taken to be when the nearest keyframe is looked for and none in
  // view has a pose, metres. It only weighs walking against turning: smaller counts walking more.
  double unknown_depth_m = 1.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// How far apart two views of a scene at `depth_m` are: 1 is what min_baseline and min_rotation ask
// for.
[[nodiscard]] double viewDistance(const Transform& a, const Transform& b, double depth_m,
                                  const KeyframeOptions& options);

// The keyframe nearest to the pose (omega of Eq. 21, with the rotation counted too) among those
// that see one of the detected markers: a nearer one behind a wall, or behind drift, says nothing
// about this frame. Empty when there is none.
[[nodiscard]] std::optional<KeyframeId> referenceKeyframe(
    const Map& map, std::span<const MarkerDetection> detections, const Transform& T_w_c,
    double depth_m, const KeyframeOptions& options);

enum class KeyframeReason { kNone, kNewMarker, kMarkerResolved, kBaseline };

// Rules 1, 2a and 2b of section 4.4. `resolved`: an unposed marker is unambiguous in this frame. By
// rule 2b a frame is taken only if culling would keep it; the rule holds for all detections
// together and for each marker without a pose.
[[nodiscard]] KeyframeReason keyframeReason(const Map& map,
                                            std::span<const MarkerDetection> detections,
                                            const Transform& T_w_c, double depth_m, bool resolved,
                                            const KeyframeOptions& options);

}  // namespace waymark::slam
