// The simulator as a live camera: rendered ahead, played in real time, forever.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "capture/frame_source.h"
#include "capture/wall_clock.h"
#include "simulator/simulation.h"

namespace waymark::simulator {

struct LiveOptions {
  // Its duration is replaced by the loop's. Blackouts and other events come again in every loop.
  Options simulation;

  // Seconds until the motion repeats itself, without a jump. Longer is more varied, and takes more
  // time and memory before the start (the frames are kept: 0.3 MB each at 640x480).
  double loop_s = 8.0;

  int buffers = 8;  // frames that may be in use at the same time
  int threads = 2;  // that render before the start

  // calib.yml and gt_map.json are written here when the camera opens; gt_traj.txt when it closes,
  // one line for each frame handed out, t its utime in seconds.
  std::optional<std::filesystem::path> truth_directory;
};

// Time runs from the first read(). As a driver does, the camera keeps the last few frames for a
// late reader; older ones are dropped and counted. One thread reads; frames go back from any.
class LiveSimulatedSource : public capture::FrameSource {
 public:
  ~LiveSimulatedSource() override;

  [[nodiscard]] const capture::StreamInfo& info() const override { return info_; }
  // A frame comes once it is exposed and read out; its stamp names mid-exposure on both clocks.
  [[nodiscard]] capture::ReadResult read(std::chrono::milliseconds timeout) override;
  [[nodiscard]] capture::SourceCounters counters() const override { return counters_; }

  // The truth of the frame with that sequence number.
  [[nodiscard]] slam::Transform poseAt(std::uint64_t sequence) const {
    return simulation_->poseAt(loopFrame(sequence));
  }
  [[nodiscard]] const Simulation& simulation() const { return *simulation_; }
  [[nodiscard]] const slam::Calibration& camera() const { return simulation_->camera(); }

  // Writes gt_traj.txt, where asked for. The destructor does so too, but cannot say what failed.
  [[nodiscard]] Status close();

 private:
  friend Result<std::unique_ptr<LiveSimulatedSource>> openLive(const LiveOptions& options);
  using Clock = std::chrono::steady_clock;  // CLOCK_MONOTONIC

  LiveSimulatedSource(std::unique_ptr<const Simulation> simulation, const LiveOptions& options);

  void renderLoop(int threads);
  void start();
  // When the frame has been read out.
  [[nodiscard]] Clock::time_point readyTime(std::uint64_t sequence) const;
  void dropLate(Clock::time_point now);
  [[nodiscard]] capture::FramePtr takeNext();
  [[nodiscard]] std::int64_t loopFrame(std::uint64_t sequence) const;

  struct HandedOut {
    std::int64_t utime;
    std::uint64_t sequence;
  };

  std::unique_ptr<const Simulation> simulation_;
  std::optional<std::filesystem::path> truth_directory_;
  capture::StreamInfo info_;
  capture::FramePool pool_;
  capture::SourceCounters counters_;
  std::vector<std::uint8_t> loop_;  // every frame of the loop, one after the other
  std::optional<Clock::time_point> started_;
  capture::WallClock wall_clock_;
  std::uint64_t next_ = 0;
  std::deque<HandedOut> handed_out_;  // a deque: growing never copies what is there
};

// Renders the loop before it returns. An Error says which option is wrong and why, or names the
// file that cannot be written.
[[nodiscard]] Result<std::unique_ptr<LiveSimulatedSource>> openLive(const LiveOptions& options);

}  // namespace waymark::simulator
