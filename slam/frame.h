// What goes into the SLAM with a frame, and what comes out.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "base/image_view.h"
#include "slam/detection/marker_detection.h"
#include "slam/frame_time.h"
#include "slam/geometry/transform.h"
#include "slam/no_pose_reason.h"
#include "slam/pose_estimate.h"

namespace waymark::slam {

// What somebody else has found out about an earlier frame (a relocalizer in a thread of its own):
// the camera in the frame of what it saw, never in the world, so that a correction of the map in
// between cannot make it stale.
struct LateResult {
  std::uint64_t sequence = 0;  // the frame's
  std::uint64_t generation =
      0;              // of the SLAM that the frame went to: one exchanged since ignores it
  int landmark = -1;  // what was seen
  Transform T_m_c;
  Matrix6d covariance = Matrix6d::Zero();  // of (dp, dtheta) of T_m_c: metres, radians
};

struct FrameInput {
  FrameTime time;
  // Of the camera's size. Markers are looked for in it, unless `detections` has them already.
  std::optional<ImageView> image{};
  // Corners found elsewhere, with their normalized coordinates.
  std::optional<std::span<const MarkerDetection>> detections{};
  // An input like the others: a replay that gives the same at the same frame gives the same poses.
  // No stage takes any yet.
  std::span<const LateResult> late{};
};

// What the system is doing; seed 1, Fig. 4.
enum class TrackingState {
  kInitializing,  // no map yet
  kTracking,      // this frame has a pose from markers
  kBridging,      // it has one, from natural features or motion
  kRelocalizing,  // there is a map, but this frame has no pose
};

struct FrameResult {
  TrackingState state = TrackingState::kInitializing;
  std::optional<PoseEstimate> pose;
  NoPoseReason reason = NoPoseReason::kNone;
  bool map_changed = false;
  bool keyframe_added = false;
  // Valid until the next call.
  std::span<const MarkerDetection> detections;
};

}  // namespace waymark::slam
