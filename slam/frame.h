// What goes into the SLAM with a frame, and what comes out.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "base/image_view.h"
#include "slam/detection/marker_detection.h"
#include "slam/frame_time.h"
#include "slam/late_result.h"
#include "slam/no_pose_reason.h"
#include "slam/pose_estimate.h"

namespace waymark::slam {

struct FrameInput {
  FrameTime time;
  // Of the camera's size. Markers are looked for in it, unless `detections` has them already.
  std::optional<ImageView> image{};
  // Corners found elsewhere, with their normalized coordinates.
  std::optional<std::span<const MarkerDetection>> detections{};
  // Of frames that were `awaited`. Inputs like the others: a replay that gives the same at the same
  // frame gives the same poses.
  std::span<const LateResult> late{};
  // Somebody else looks for pictures in this frame, and will tell in `late` of another one.
  bool awaited = false;
  // Pictures that were found in this very frame: of photographs (Options::treatAsUnorderedImages),
  // through the lens in use.
  std::span<const LateResult> found{};
};

// What the system is doing; seed 1, Fig. 4.
enum class TrackingState {
  kInitializing,  // no map yet
  kTracking,      // this frame has a pose from markers
  kBridging,      // it has one, from natural features or motion
  kRelocalizing,  // there is a map, but this frame has no pose
  kLost,          // the same, since a carried pose became less certain than its limit
};

// Two pieces of the map have become one world, or are two again. From this frame on coordinates are
// other ones, as after a loop closure.
struct PieceEvent {
  enum class Kind { kJoined, kParted };
  Kind kind = Kind::kJoined;
  int piece = 0;           // is part of `into` now; or has its own world again
  int into = 0;            // keeps its world
  Transform T_into_piece;  // from the one world to the other
  Matrix6d covariance =
      Matrix6d::Zero();  // of (dp, dtheta) of T_into_piece, in the world of `into`
};

struct FrameResult {
  TrackingState state = TrackingState::kInitializing;
  std::optional<PoseEstimate> pose;
  NoPoseReason reason = NoPoseReason::kNone;
  bool map_changed = false;
  bool keyframe_added = false;
  // Both valid until the next call.
  std::span<const PieceEvent> piece_events;  // in their order
  std::span<const MarkerDetection> detections;
  std::span<const LateResult> found{};  // as it came
};

}  // namespace waymark::slam
