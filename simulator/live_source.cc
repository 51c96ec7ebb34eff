#include "simulator/live_source.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "io/trajectory.h"
#include "simulator/simulated_source.h"
#include "simulator/truth_files.h"

namespace waymark::simulator {
namespace {

// Frames a driver keeps for a late reader; V4L2 applications usually ask for four.
constexpr std::uint64_t kDriverQueue = 4;
constexpr double kMaxMegabytes = 4096.0;

std::string invalidReason(const LiveOptions& options) {
  if (!(options.loop_s > 0.0 && options.loop_s <= 3600.0)) {
    return "the loop must be longer than 0 and at most 3600 seconds";
  }
  if (options.buffers < 1 || options.buffers > 1024) return "buffers must be 1 to 1024";
  if (options.threads < 1 || options.threads > 256) return "threads must be 1 to 256";
  return {};
}

std::size_t imageBytes(const slam::Calibration& camera) {
  return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

std::chrono::nanoseconds seconds(double s) {
  return std::chrono::nanoseconds(std::llround(s * 1e9));
}

Status beginTruth(const std::filesystem::path& directory, const Simulation& simulation) {
  std::error_code failed;
  std::filesystem::create_directories(directory, failed);
  if (failed) return Error{directory.string() + ": cannot make directory: " + failed.message()};
  return writeStaticTruth(directory, simulation);
}

}  // namespace

Result<std::unique_ptr<LiveSimulatedSource>> openLive(const LiveOptions& options) {
  if (std::string reason = invalidReason(options); !reason.empty()) return Error{reason};
  // The rate may be the scene's own: look it up before rounding the loop to whole frames.
  Result<Scene> scene = buildScene(options.simulation, Ending::kClosedLoop);
  if (!scene) return scene.error();
  const double frames = std::max(1.0, std::round(options.loop_s * scene->rate_hz));
  const double megabytes = frames * static_cast<double>(imageBytes(scene->camera)) / 1e6;
  if (megabytes > kMaxMegabytes) {
    return Error{"the loop would take " + std::to_string(std::lround(megabytes)) +
                 " MB of memory (at most " + std::to_string(std::lround(kMaxMegabytes)) +
                 "): shorten it, or lower rate or size"};
  }
  Options simulated = options.simulation;
  simulated.duration_s = frames / scene->rate_hz;
  auto simulation = Simulation::create(simulated, Ending::kClosedLoop);
  if (!simulation) return simulation.error();
  if (options.truth_directory) {
    if (Status status = beginTruth(*options.truth_directory, **simulation); !status) {
      return status.error();
    }
  }
  return std::unique_ptr<LiveSimulatedSource>(
      new LiveSimulatedSource(std::move(*simulation), options));
}

LiveSimulatedSource::LiveSimulatedSource(std::unique_ptr<const Simulation> simulation,
                                         const LiveOptions& options)
    : simulation_(std::move(simulation)),
      truth_directory_(options.truth_directory),
      info_(streamInfo(simulation_->scene())),
      pool_(info_.width, info_.height, options.buffers) {
  info_.live = true;
  info_.description += ", live";
  renderLoop(options.threads);
}

LiveSimulatedSource::~LiveSimulatedSource() {
  const Status status = close();
  static_cast<void>(status);  // nobody left to tell
}

void LiveSimulatedSource::renderLoop(int threads) {
  const std::size_t bytes = imageBytes(simulation_->camera());
  loop_.resize(bytes * static_cast<std::size_t>(simulation_->frameCount()));
  std::atomic<std::int64_t> next{0};
  const auto work = [&] {
    Simulation::Workspace workspace;
    for (std::int64_t k = next++; k < simulation_->frameCount(); k = next++) {
      simulation_->render(k, &workspace, loop_.data() + bytes * static_cast<std::size_t>(k));
    }
  };
  std::vector<std::jthread> workers;
  for (int i = 1; i < threads; ++i) workers.emplace_back(work);
  work();
}

void LiveSimulatedSource::start() { started_ = Clock::now(); }

LiveSimulatedSource::Clock::time_point LiveSimulatedSource::readyTime(
    std::uint64_t sequence) const {
  const Options& options = simulation_->options();
  const double mid_exposure_s = static_cast<double>(sequence) / info_.rate_hz;
  return *started_ + seconds(mid_exposure_s + 0.5 * options.exposure_s + 0.5 * options.readout_s);
}

void LiveSimulatedSource::dropLate(Clock::time_point now) {
  // The oldest frame goes when the one that would be the fifth in the queue is ready.
  while (readyTime(next_ + kDriverQueue) <= now) {
    ++next_;
    ++counters_.dropped_late;
  }
}

std::int64_t LiveSimulatedSource::loopFrame(std::uint64_t sequence) const {
  return static_cast<std::int64_t>(sequence) % simulation_->frameCount();
}

capture::ReadResult LiveSimulatedSource::read(std::chrono::milliseconds timeout) {
  if (!started_) start();
  const Clock::time_point deadline = Clock::now() + timeout;
  for (;;) {
    dropLate(Clock::now());
    const Clock::time_point ready = readyTime(next_);
    if (ready > deadline) {
      std::this_thread::sleep_until(deadline);
      return capture::TimedOut{};
    }
    std::this_thread::sleep_until(ready);
    if (capture::FramePtr frame = takeNext()) return frame;
  }
}

// Null when every buffer is in use; the frame is lost then.
capture::FramePtr LiveSimulatedSource::takeNext() {
  const std::uint64_t sequence = next_++;
  capture::FramePtr frame = pool_.acquire();
  if (!frame) {
    ++counters_.dropped_no_buffer;
    return nullptr;
  }
  const std::size_t bytes = imageBytes(simulation_->camera());
  std::memcpy(frame->pixels(), loop_.data() + bytes * static_cast<std::size_t>(loopFrame(sequence)),
              bytes);
  const double time_s = static_cast<double>(sequence) / info_.rate_hz;
  const auto monotonic = (*started_ + seconds(time_s)).time_since_epoch();
  const std::int64_t monotonic_ns =
      std::chrono::duration_cast<std::chrono::nanoseconds>(monotonic).count();
  wall_clock_.update();
  frame->setStamp({.sequence = sequence,
                   .monotonic_ns = monotonic_ns,
                   .utime = wall_clock_.utime(monotonic_ns),
                   .exposure_ns = std::llround(simulation_->options().exposure_s * 1e9)});
  ++counters_.frames;
  if (truth_directory_) handed_out_.push_back({frame->stamp().utime, sequence});
  return frame;
}

Status LiveSimulatedSource::close() {
  if (!truth_directory_) return success();
  io::Trajectory truth;
  for (const HandedOut& frame : handed_out_) {
    truth.push_back({1000 * frame.utime, poseAt(frame.sequence)});
  }
  const std::filesystem::path path = *truth_directory_ / "gt_traj.txt";
  truth_directory_.reset();
  handed_out_.clear();
  return io::writeTrajectory(path, truth);
}

}  // namespace waymark::simulator
