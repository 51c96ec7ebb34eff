// What became of each frame, as CSV: poses.csv and poses_final.csv of `waymark run`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>

#include "io/trajectory.h"
#include "slam/pose_estimate.h"

namespace waymark::io {

enum class FrameStatus {
  kInitializing,  // there is no map yet
  kTracking,      // this frame has a pose from markers
  kBridging,      // it has one, from natural features or motion
  kRelocalizing,  // live: there is a map, but this frame has no pose
  kLost,          // the same, live since a carried pose became too uncertain; and at the end
};

struct FramePose {
  std::int64_t time_ns = 0;  // mid-exposure
  std::size_t frame = 0;     // counted from 0
  FrameStatus status = FrameStatus::kInitializing;
  std::optional<slam::PoseEstimate> pose;
  std::string reason;  // why there is no pose, for people
};

// A line for each frame, below a line with the names of the columns: seconds; frame; status;
// source; piece of the map; position in metres; quaternion; the upper triangle of the covariance
// in the world, row by row, metres and radians; markers; natural features; RMS in pixels;
// reason; ambiguity ratio. Fields that only a pose has are empty without one. Equal input, equal
// bytes.
[[nodiscard]] std::string formatFramePoses(std::span<const FramePose> frames);

// Of those that have a pose, by the piece of the map that it is in: each has its own world.
[[nodiscard]] std::map<int, Trajectory> trajectoriesOf(std::span<const FramePose> frames);

}  // namespace waymark::io
