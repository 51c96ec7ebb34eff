// Frames that came before, seen again with the map as it is now: for the final trajectory, and for
// more views in the optimisation at the end of a recording than keyframes alone give (beyond seed
// 1, section 4.10).
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "slam/geometry/camera_model.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/mapping/readout.h"
#include "slam/marker_watch/marker_watch.h"
#include "slam/tracking/known_marker.h"
#include "slam/tracking/tracker.h"

namespace waymark::slam {

struct PastFrame {
  std::uint64_t sequence = 0;
  std::int64_t monotonic_ns = 0;  // mid-exposure
  std::span<const MarkerDetection> detections;
  Transform T_w_c;  // a first guess: as estimated then, or a neighbour's
  Vector6d twist = Vector6d::Zero();
};

// Where a past frame is in the map.
struct LocatedFrame {
  std::vector<MarkerDetection> detections;  // as at the middle row's time
  std::vector<KnownMarker> known;           // pointing into `detections`
  PoseSolution solution;
};

// All that it is given must outlive it.
class PastFrameLocator {
 public:
  PastFrameLocator(const MarkerWatch& watch, const CameraModel& camera, const Readout& readout,
                   const Tracker& tracker)
      : watch_(watch), camera_(camera), readout_(readout), tracker_(tracker) {}

  // Empty when too few of its markers are in the map, or they do not fit it.
  [[nodiscard]] std::optional<LocatedFrame> locate(const Map& map, const PastFrame& frame) const;

  // Makes keyframes of frames that are none, and gives those that are the markers that fit by now.
  // Keyframes up to last_old (-1: none) are another run's, with another clock, and stay as they
  // are.
  void addViews(std::span<const PastFrame> frames, KeyframeId last_old, Map* map) const;

 private:
  // A keyframe of the markers that fit the map.
  [[nodiscard]] std::optional<Keyframe> viewOf(const PastFrame& frame, const Map& map) const;

  const MarkerWatch& watch_;
  const CameraModel& camera_;
  const Readout& readout_;
  const Tracker& tracker_;
};

}  // namespace waymark::slam
