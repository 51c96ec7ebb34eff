// Frames that came before, seen again with the map as it is now: for the final trajectory, and for
// more views in the optimization at the end of a recording than keyframes alone give (beyond seed
// 1, section 4.10).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "slam/camera/rolling_shutter_estimator.h"
#include "slam/camera_pose/known_marker.h"
#include "slam/geometry/camera_model.h"
#include "slam/late_result.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/marker_screening/marker_screening.h"
#include "slam/pose_estimate.h"
#include "slam/tracking/single_marker_view.h"
#include "slam/tracking/tracker.h"

namespace waymark::slam {

struct RecordedFrame {
  std::uint64_t sequence = 0;
  std::int64_t monotonic_ns = 0;  // mid-exposure
  std::span<const MarkerDetection> detections;
  Transform T_w_c;  // a first guess: as estimated then, or a neighbour's
  Vector6d twist = Vector6d::Zero();
  int piece = 0;                        // the world of the guess
  std::span<const LateResult> found{};  // pictures in it, of a photograph
};

// Where a recorded frame is in the map.
struct LocatedFrame {
  std::vector<MarkerDetection> detections;  // as at the middle row's time
  std::vector<KnownMarker> known;           // pointing into `detections`
  PoseSolution solution;
};

// One in which the map knows one marker only: at both of its poses, in the order of `view`.
struct FrameOfOneMarker {
  std::vector<MarkerDetection> detections;  // as at the middle row's time
  std::vector<KnownMarker> known;           // one, pointing into `detections`
  SingleMarkerView view;
  std::array<PoseSolution, 2> solutions;
};

// The same as two results.
struct PosesOfOneMarker {
  int marker = -1;
  std::array<PoseEstimate, 2> poses;  // the one that explains the image better first
  double log_odds = 0.0;              // as SingleMarkerView's, and so is the barrier
  double barrier = 0.0;
};

// All that it is given must outlive it.
class RecordedFrameLocator {
 public:
  RecordedFrameLocator(const MarkerScreening& screening, const CameraModel& camera,
                       const RollingShutterEstimator& readout, const Tracker& tracker)
      : screening_(screening), camera_(camera), rolling_shutter_(readout), tracker_(tracker) {}

  // Empty when too few of its markers are in the map, or they do not fit it.
  [[nodiscard]] std::optional<LocatedFrame> locate(const Map& map,
                                                   const RecordedFrame& frame) const;

  // Empty when the map knows none of its markers, or several, or the corners give no pose.
  [[nodiscard]] std::optional<FrameOfOneMarker> locateByOneMarker(
      const Map& map, const RecordedFrame& frame, const SquarePoseOptions& square) const;

  // Makes keyframes of frames that are none, and gives those that are the markers that fit by now.
  // Keyframes up to last_old (-1: none) are another run's, with another clock, and stay as they
  // are.
  void densify(std::span<const RecordedFrame> frames, KeyframeId last_old, Map* map) const;

 private:
  // A keyframe of the markers that fit the map.
  [[nodiscard]] std::optional<Keyframe> viewOf(const RecordedFrame& frame, const Map& map) const;

  const MarkerScreening& screening_;
  const CameraModel& camera_;
  const RollingShutterEstimator& rolling_shutter_;
  const Tracker& tracker_;
};

}  // namespace waymark::slam
