// When a lens changed under way. A map that grows follows at first, by bending; the change is
// noticed when it can no longer, and from the views since then the new lens is learned. Which of
// the views before were seen through it already is asked of the map as it was before.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "base/task.h"
#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/bundle_adjuster.h"

namespace waymark::slam {

struct LensChange {
  CameraModel before;
  CameraModel after;
  std::int64_t noticed_ns = 0;  // monotonic, as keyframes have it
  // Not earlier than that: when the one before changed.
  std::int64_t first_ns = std::numeric_limits<std::int64_t>::min();
  double readout_s = 0.0;
};

// The time of the first keyframe that was seen through the new lens. Where the markers are follows
// from the keyframes well before; each later one is fitted to them through either lens, and the
// time is the one that explains all of them best. Empty where they do not tell. What is given by
// reference must outlive the task.
Task<std::optional<std::int64_t>> dateChange(const Map& map, LensChange change,
                                             const MarkerOptions& markers, BundleOptions options,
                                             Budget* budget);

}  // namespace waymark::slam
