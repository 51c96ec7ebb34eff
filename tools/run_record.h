// What happened in a run, frame by frame, and the files that tell of it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "io/recorded_detections.h"
#include "io/trajectory.h"
#include "slam/slam.h"
#include "tools/stage_timer.h"

namespace waymark::tools {

struct FrameRecord {
  std::int64_t time_ns = 0;
  std::optional<slam::PoseEstimate> pose;  // as it would have been published live
  std::vector<slam::MarkerDetection> detections;
};

class RunRecord {
 public:
  // `counters` as they are after the frame.
  void add(std::int64_t time_ns, const slam::FrameResult& result, const slam::Counters& counters);

  // The lens turned out to be another one. A marker it cannot have seen leaves its frame.
  void undistortAgain(const slam::CameraModel& camera);

  [[nodiscard]] std::size_t frames() const { return frames_.size(); }
  [[nodiscard]] std::size_t localized() const { return localized_; }
  [[nodiscard]] double localizedPercent() const;

  // Every frame's pose at its time: causal.
  [[nodiscard]] io::Trajectory liveTrajectory() const;
  // Every frame's pose against the map as it is now.
  [[nodiscard]] io::Trajectory finalTrajectory(const slam::Slam& slam) const;
  // For the optimization at the end: `count` frames, evenly spread, and more of those that show a
  // marker with fewer than `views_per_marker` among them. One that had no pose live comes with the
  // pose of the last one before it that had (or, in front of the first, of that). They point into
  // this record. Empty when no frame had a pose.
  [[nodiscard]] std::vector<slam::RecordedFrame> spreadFrames(std::size_t count,
                                                              std::size_t views_per_marker) const;
  // Those that had no pose live, in their order; T_w_c says nothing. They point into this record.
  [[nodiscard]] std::vector<slam::RecordedFrame> framesWithoutPose() const;
  // Every frame's detections, for replaying them.
  [[nodiscard]] std::vector<io::RecordedFrame> recordedFrames() const;
  // stats.json of the interface.
  [[nodiscard]] std::string statistics(const slam::Slam& slam, const StageTimer& timer,
                                       std::uint64_t dropped_late) const;

 private:
  [[nodiscard]] std::optional<slam::PoseEstimate> firstPose() const;
  // Whether each frame is one of spreadFrames().
  [[nodiscard]] std::vector<bool> spread(std::size_t count, std::size_t views_per_marker) const;

  std::vector<FrameRecord> frames_;
  std::size_t localized_ = 0;
  std::optional<std::size_t> initialized_at_;  // index of the first frame with a pose
  std::uint64_t loop_closures_ = 0;
  std::vector<std::int64_t> loop_closed_at_ns_;  // times of the frames in which loops closed
};

}  // namespace waymark::tools
