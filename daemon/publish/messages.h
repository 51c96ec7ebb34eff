// From our own types to the messages on the wire. Nothing here knows about time or networks.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include <bot_core/pose_t.hpp>

#include "daemon/frames/frame_record.h"
#include "daemon/publish/body_motion.h"
#include <waymark/detections_t.hpp>
#include <waymark/joint_t.hpp>
#include <waymark/map_t.hpp>
#include <waymark/pose_t.hpp>

namespace waymark::daemon {

// Messages are filled in place: the publisher keeps one of each and with it the memory.

// `last_pose_ns`: monotonic time of the last frame with a pose, this one included; empty when there
// never was one. latency_ns is left to whoever sends it.
void fillPose(const FrameRecord& record, std::optional<std::int64_t> last_pose_ns, pose_t& message);

// A pose message that no frame stands behind, because there is no camera. Keeps the sequence of
// `message`, the last one sent.
void fillNoCamera(const std::string& reason, std::int64_t utime, std::int64_t monotonic_ns,
                  std::optional<std::int64_t> last_pose_ns, pose_t& message);

void fillDetections(const FrameRecord& record, const std::string& dictionary,
                    detections_t& message);

void fillJoint(const slam::PieceEvent& event, const capture::FrameStamp& stamp, joint_t& message);

// Parts of a map, each below 60 kB.
[[nodiscard]] int mapPieceCount(const MapSnapshot& map);
void fillMapPiece(const MapSnapshot& map, const std::string& dictionary, std::int64_t revision,
                  int piece, map_t& message);

// For subscribers that know bot_core only.
void fillBotCorePose(const BodyState& state, std::int64_t utime, bot_core::pose_t& message);

}  // namespace waymark::daemon
