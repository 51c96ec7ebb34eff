// What the SLAM loop tells the publisher about one frame: plain data of fixed size, so that handing
// it over allocates nothing.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "capture/frame.h"
#include "daemon/frames/stage_clock.h"
#include "daemon/natural/relocalizer_link.h"
#include "slam/late_result.h"
#include "slam/slam.h"

namespace waymark::daemon {

struct SeenMarker {
  int id = -1;
  int hamming = 0;
  std::array<Eigen::Vector2d, 4> pixels;  // as in slam::MarkerDetection
};

// The lens in use, after a frame.
struct LensRecord {
  slam::Calibration calibration;
  slam::LensState state = slam::LensState::kGiven;
  double focal_sigma = 0.0;  // as a share
  double rms_before_px = 0.0;
  double rms_after_px = 0.0;
  int changes = 0;
};

struct FrameRecord {
  // As many as fit in one message of 60 kB with room to spare, and more than any picture shows.
  static constexpr int kMaxSeen = 256;
  // One joint in a frame, and no more undone than are on trial.
  static constexpr std::size_t kMaxEvents = 8;

  capture::FrameStamp stamp;
  slam::TrackingState state = slam::TrackingState::kInitializing;
  slam::NoPoseReason reason = slam::NoPoseReason::kNone;
  std::optional<slam::PoseEstimate> pose;
  int map_piece = 0;  // that the camera is in, or was in last
  std::size_t piece_events = 0;
  std::array<slam::PieceEvent, kMaxEvents> events{};
  std::int64_t processing_ns = 0;  // from leaving the queue to this record
  // What of kFrameStages took longest, when processing took longer than the time between frames.
  std::optional<std::size_t> missed_deadline_in;
  slam::Counters counters;  // as they stood after this frame
  LensRecord lens;

  // The search for natural markers, as it was this frame's input.
  bool searched = false;
  std::size_t heard = 0;
  std::array<slam::LateResult, RelocalizerLink::kMostResults> late;

  int seen = 0;  // may be larger than kMaxSeen; then the rest is not in `markers`
  std::array<SeenMarker, kMaxSeen> markers;
};

// The map as the publisher needs it. Its vector keeps its memory from one use to the next.
struct MapSnapshot {
  struct Marker {
    int id = -1;
    double size_m = 0.0;
    slam::Transform T_w_m;
    slam::Matrix6d covariance = slam::Matrix6d::Zero();  // in the world; zero where not known
    bool undecided = false;                              // there is a second pose
    int views = 0;                                       // keyframes that saw it
    int map_piece = 0;                                   // whose world that is
  };
  struct Unposed {
    int id = -1;
    double size_m = 0.0;
    slam::MarkerState state = slam::MarkerState::kUnresolved;
    int views = 0;
  };

  capture::FrameStamp stamp;  // of the frame after which the map was like this
  int keyframe_count = 0;
  std::vector<Marker> markers;   // squares
  std::vector<Unposed> unposed;  // squares
  std::vector<Marker> pictures;  // natural markers; size_m is the width
};

}  // namespace waymark::daemon
