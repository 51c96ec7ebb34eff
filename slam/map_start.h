// The first frames (seed 1, section 4.1): from the first markers in view to a map, and the pose of
// the frame that made it.
#pragma once

#include <optional>
#include <span>

#include "slam/covariance/map_covariance.h"
#include "slam/frame_time.h"
#include "slam/geometry/camera_model.h"
#include "slam/initialization/initializer.h"
#include "slam/map/map.h"
#include "slam/mapping/map_updater.h"
#include "slam/no_pose_reason.h"
#include "slam/options.h"
#include "slam/pose_estimate.h"
#include "slam/tracking/tracker.h"

namespace waymark::slam {

// What it works on, all of it another's, which must outlive it.
struct MapStartParts {
  const Options& options;
  const CameraModel& camera;
  const Tracker& tracker;
  MapUpdater* updater;
  MapCovariance* covariance;
  Map* map;
};

class MapStart {
 public:
  explicit MapStart(const MapStartParts& parts)
      : with_(parts),
        initializer_(parts.options.markers, parts.camera.focalLength(),
                     parts.options.initialization) {}

  // One of the frames before there is a map. kNone when it is there now, else what it lacks.
  NoPoseReason process(std::span<const MarkerDetection> usable, const FrameTime& time);
  // Of the last of these frames. Empty where it made no map, or has no pose in the one it made.
  [[nodiscard]] const std::optional<PoseEstimate>& pose() const { return pose_; }

 private:
  MapStartParts with_;
  Initializer initializer_;
  std::optional<PoseEstimate> pose_;
};

}  // namespace waymark::slam
