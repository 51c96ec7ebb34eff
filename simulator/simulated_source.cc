#include "simulator/simulated_source.h"

#include <cmath>
#include <cstdio>
#include <utility>

namespace waymark::simulator {
namespace {

constexpr int kBuffers = 8;

}  // namespace

capture::StreamInfo streamInfo(const Scene& scene) {
  char text[128];
  std::snprintf(text, sizeof text, "simulated %s, %dx%d, %g Hz", scene.name.c_str(),
                scene.camera.width, scene.camera.height, scene.rate_hz);
  return {.width = scene.camera.width,
          .height = scene.camera.height,
          .rate_hz = scene.rate_hz,
          .frame_count = -1,
          .live = false,
          .description = text};
}

SimulatedSource::SimulatedSource(std::unique_ptr<const Simulation> simulation)
    : simulation_(std::move(simulation)),
      info_(streamInfo(simulation_->scene())),
      pool_(info_.width, info_.height, kBuffers) {
  info_.frame_count = simulation_->frameCount();
}

capture::ReadResult SimulatedSource::read(std::chrono::milliseconds /*timeout*/) {
  if (next_ >= simulation_->frameCount()) return capture::EndOfStream{};
  capture::FramePtr frame = pool_.acquire();
  if (!frame) {
    return Error{info_.description + ", frame " + std::to_string(next_) +
                 ": every frame buffer is in use"};
  }
  simulation_->render(next_, &workspace_, frame->pixels());
  const double time_s = simulation_->timeOf(next_);
  frame->setStamp({.sequence = static_cast<std::uint64_t>(next_),
                   .monotonic_ns = std::llround(time_s * 1e9),
                   .utime = std::llround(time_s * 1e6),
                   .exposure_ns = std::llround(simulation_->options().exposure_s * 1e9)});
  ++next_;
  ++counters_.frames;
  return frame;
}

Result<std::unique_ptr<SimulatedSource>> openSimulation(const Options& options) {
  auto simulation = Simulation::create(options, Ending::kOfTheScene);
  if (!simulation) return simulation.error();
  return std::make_unique<SimulatedSource>(std::move(*simulation));
}

}  // namespace waymark::simulator
