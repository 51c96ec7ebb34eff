// The neighbourhood of the reference keyframe: which of the markers in view may be tracked, and
// which of them close a loop (seed 1, sections 4.2 and 4.9.1).
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "slam/camera_pose/known_marker.h"
#include "slam/keyframes/keyframe_policy.h"
#include "slam/map/map.h"

namespace waymark::slam {

// The detected markers of known pose, by what they are good for.
struct SplitMarkers {
  std::vector<KnownMarker> eligible;  // L'(t), Eq. 36
  std::vector<KnownMarker> loop;      // L(t), Eq. 35
};

class LocalMarkers {
 public:
  // Without a reference keyframe (just relocalized, or nothing known in view) all are eligible.
  void split(std::span<const KnownMarker> known, SplitMarkers* markers) const;

  // Chooses the reference keyframe f^omega for the next frame, from this one's pose and the
  // detections that fit it (Eq. 21). depth_m: of their markers; empty where none has a pose.
  void update(const Map& map, std::span<const MarkerDetection> fitting, const Transform& T_w_c,
              const std::optional<double>& depth_m, const KeyframeOptions& options);
  // The map changed otherwise, or tracking was lost.
  void reset() { reference_.reset(); }
  [[nodiscard]] std::optional<KeyframeId> reference() const { return reference_; }
  // G_m of the reference (Eq. 31), sorted; empty without one.
  [[nodiscard]] std::span<const int> ids() const {
    return reference_ ? std::span<const int>(local_markers_) : std::span<const int>{};
  }

 private:
  std::optional<KeyframeId> reference_;
  KeyframeId newest_ = -1;  // of the map when local_markers_ was made
  std::vector<int> local_markers_;
};

}  // namespace waymark::slam
