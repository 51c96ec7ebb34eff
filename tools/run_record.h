// What happened in a run, frame by frame, and the files that tell of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "io/frame_poses.h"
#include "io/recorded_detections.h"
#include "slam/final_map.h"
#include "slam/slam.h"
#include "tools/diagnosis/run_verdict.h"
#include "tools/stage_timer.h"

namespace waymark::tools {

// Of all pieces of the map.
[[nodiscard]] std::size_t keyframesOf(const slam::Slam& slam);

class RunRecord {
 public:
  // max_frames: of a camera, which goes on for ever: at least so many of the latest frames are
  // kept, and less than twice as many. All are counted.
  explicit RunRecord(std::size_t max_frames = std::numeric_limits<std::size_t>::max())
      : max_frames_(max_frames) {}

  // `counters` and the lens as they are after the frame.
  void add(std::int64_t time_ns, const slam::FrameResult& result, const slam::Counters& counters,
           slam::LensState lens);

  // Images in no order: their map is begun anew, in an order of their own.
  void placeInOrder(slam::Slam* slam);

  // For the map's end (slam::makeFinalMap()), which may change their corners.
  [[nodiscard]] std::span<slam::LiveFrame> liveFrames() { return frames_; }

  [[nodiscard]] std::span<const slam::LiveFrame> keptFrames() const { return frames_; }

  [[nodiscard]] std::size_t frames() const { return forgotten_ + frames_.size(); }
  // Of these the earliest, which are counted and in none of the following.
  [[nodiscard]] std::size_t forgotten() const { return forgotten_; }
  [[nodiscard]] std::size_t localized() const { return localized_; }
  [[nodiscard]] double localizedPercent() const;

  // Every frame as it was at its time: causal; and against the map as it is at the end: with and
  // without a pose, one after the other.
  [[nodiscard]] std::vector<io::FramePose> livePoses() const;
  [[nodiscard]] std::vector<io::FramePose> finalPoses(const slam::Slam& slam,
                                                      bool unordered_images) const;
  // Why frames had no pose, and how many of those kept each.
  [[nodiscard]] std::map<slam::NoPoseReason, std::size_t> reasons() const;
  // Root mean square of the reprojection errors of the poses from markers, pixels; 0 without any.
  // Natural features fit as well as their patches are found, which says nothing of the lens.
  [[nodiscard]] double reprojectionRms_px() const;
  // Every frame's detections, for replaying them.
  [[nodiscard]] std::vector<io::RecordedFrame> recordedFrames() const;
  // When each of all closed loops closed: the time of the frame; `counters` as they are at the end.
  [[nodiscard]] std::vector<std::int64_t> loopClosedAt_ns(const slam::Counters& counters) const;
  // Time of the frame since which the lens is learned; empty while it is not.
  [[nodiscard]] std::optional<std::int64_t> lensLearnedAt_ns() const { return lens_learned_at_ns_; }
  // stats.json of the interface. `incomplete`: why there is more than these results tell; usually
  // empty.
  [[nodiscard]] std::string statistics(const slam::Slam& slam, const StageTimer& timer,
                                       std::uint64_t dropped_late, const std::string& incomplete,
                                       const diagnosis::Verdict& verdict) const;

 private:
  void count(const slam::PoseEstimate& pose, std::size_t frame);

  std::size_t max_frames_;
  // Why a frame had no pose, or that it had one.
  struct LiveState {
    slam::TrackingState state = slam::TrackingState::kInitializing;
    slam::NoPoseReason reason = slam::NoPoseReason::kNone;
  };
  std::vector<slam::LiveFrame> frames_;
  std::vector<LiveState> states_;  // of each of them
  std::size_t forgotten_ = 0;
  std::size_t localized_ = 0;
  std::size_t by_markers_ = 0;                 // of those
  double squares_px2_ = 0.0;                   // of each of their RMS
  std::optional<std::size_t> initialized_at_;  // index of the first frame with a pose
  std::optional<std::int64_t> lens_learned_at_ns_;
  std::uint64_t loop_closures_ = 0;
  std::vector<std::int64_t> loop_closed_at_ns_;  // times of the frames in which loops closed
};

}  // namespace waymark::tools
