// What happened in a run, frame by frame, and the files that tell of it.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "io/recorded_detections.h"
#include "io/trajectory.h"
#include "slam/final_map.h"
#include "slam/slam.h"
#include "tools/stage_timer.h"

namespace waymark::tools {

class RunRecord {
 public:
  // `counters` as they are after the frame.
  void add(std::int64_t time_ns, const slam::FrameResult& result, const slam::Counters& counters);

  // For the map's end (slam::makeFinalMap()), which may change their corners.
  [[nodiscard]] std::span<slam::LiveFrame> liveFrames() { return frames_; }

  [[nodiscard]] std::size_t frames() const { return frames_.size(); }
  [[nodiscard]] std::size_t localized() const { return localized_; }
  [[nodiscard]] double localizedPercent() const;

  // Every frame's pose at its time: causal.
  [[nodiscard]] io::Trajectory liveTrajectory() const;
  // Every frame's pose against the map as it is now.
  [[nodiscard]] io::Trajectory finalTrajectory(const slam::Slam& slam) const;
  // Every frame's detections, for replaying them.
  [[nodiscard]] std::vector<io::RecordedFrame> recordedFrames() const;
  // When each of all closed loops closed: the time of the frame; `counters` as they are at the end.
  [[nodiscard]] std::vector<std::int64_t> loopClosedAt_ns(const slam::Counters& counters) const;
  // stats.json of the interface.
  [[nodiscard]] std::string statistics(const slam::Slam& slam, const StageTimer& timer,
                                       std::uint64_t dropped_late) const;

 private:
  std::vector<slam::LiveFrame> frames_;
  std::size_t localized_ = 0;
  std::optional<std::size_t> initialized_at_;  // index of the first frame with a pose
  std::uint64_t loop_closures_ = 0;
  std::vector<std::int64_t> loop_closed_at_ns_;  // times of the frames in which loops closed
};

}  // namespace waymark::tools
