// The simulator as a recording: frames on demand, without waiting, every one of them.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <vector>

#include "capture/frame_source.h"
#include "simulator/simulation.h"

namespace waymark::simulator {

class SimulatedSource : public capture::FrameSource {
 public:
  explicit SimulatedSource(std::unique_ptr<const Simulation> simulation);

  [[nodiscard]] const capture::StreamInfo& info() const override { return info_; }
  // Both clocks of frame k's stamp read k / rate.
  [[nodiscard]] capture::ReadResult read(std::chrono::milliseconds timeout) override;
  [[nodiscard]] capture::SourceCounters counters() const override { return counters_; }

  // The truth, also for frames not read yet.
  [[nodiscard]] const Simulation& simulation() const { return *simulation_; }
  [[nodiscard]] const slam::Calibration& camera() const { return simulation_->camera(); }
  [[nodiscard]] slam::Transform poseAt(std::int64_t frame) const {
    return simulation_->poseAt(frame);
  }
  [[nodiscard]] const std::vector<Marker>& markers() const { return simulation_->markers(); }

  // The next read() gives this frame.
  void seek(std::int64_t frame) { next_ = frame; }

 private:
  std::unique_ptr<const Simulation> simulation_;
  capture::StreamInfo info_;
  capture::FramePool pool_;
  capture::SourceCounters counters_;
  Simulation::Workspace workspace_;
  std::int64_t next_ = 0;
};

// An Error says which option is wrong and why.
[[nodiscard]] Result<std::unique_ptr<SimulatedSource>> openSimulation(const Options& options);

// "simulated walls, 640x480, 60 Hz"
[[nodiscard]] capture::StreamInfo streamInfo(const Scene& scene);

}  // namespace waymark::simulator
