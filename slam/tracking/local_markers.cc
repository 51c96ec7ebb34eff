#include "slam/tracking/local_markers.h"

#include <algorithm>

namespace waymark::slam {

void LocalMarkers::split(std::span<const KnownMarker> known, SplitMarkers* markers) const {
  markers->eligible.clear();
  markers->loop.clear();
  for (const KnownMarker& marker : known) {
    const bool local =
        !reference_ ||
        std::binary_search(local_markers_.begin(), local_markers_.end(), marker.detection->id);
    (local ? markers->eligible : markers->loop).push_back(marker);
  }
}

void LocalMarkers::update(const Map& map, std::span<const MarkerDetection> fitting,
                          const Transform& T_w_c, const std::optional<double>& depth_m,
                          const KeyframeOptions& options) {
  if (map.keyframes().empty()) return;
  const auto reference =
      referenceKeyframe(map, fitting, T_w_c, depth_m.value_or(options.unknown_depth_m), options);
  const KeyframeId newest = map.keyframes().rbegin()->first;
  if (reference && reference == reference_ && newest == newest_) return;
  reference_ = reference;
  newest_ = newest;
  if (reference_) local_markers_ = map.markersSeenFrom(map.neighbours(*reference_));
}

}  // namespace waymark::slam
