// How the camera is doing, as the capture thread reports it and the publisher tells the world.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <string>

#include "capture/frame_source.h"

namespace waymark::daemon {

enum class CameraState {
  kOpening,  // not yet open
  kRunning,
  kLost,   // it ran and failed; being reopened
  kEnded,  // the recording is over
};

// Written by the capture thread, read by any. The lock guards a text that changes only when the
// camera comes or goes; counting a frame takes no lock.
class CameraStatus {
 public:
  struct Report {
    CameraState state = CameraState::kOpening;
    std::string reason;  // empty while all is well
  };

  void report(CameraState state, std::string reason) {
    const std::lock_guard lock(mutex_);
    report_ = {state, std::move(reason)};
    version_.fetch_add(1, std::memory_order_release);
  }
  [[nodiscard]] Report latest() const {
    const std::lock_guard lock(mutex_);
    return report_;
  }
  // True until the first attempt to open the camera has succeeded or failed.
  [[nodiscard]] bool firstOpening() const { return version() == 0; }
  // Grows with every report: cheap to compare.
  [[nodiscard]] std::uint32_t version() const { return version_.load(std::memory_order_acquire); }

  // Totals over all times the camera was opened.
  void count(const capture::SourceCounters& total) {
    frames_.store(total.frames, std::memory_order_relaxed);
    dropped_late_.store(total.dropped_late, std::memory_order_relaxed);
    dropped_no_buffer_.store(total.dropped_no_buffer, std::memory_order_relaxed);
  }
  void countReopened() { reopened_.fetch_add(1, std::memory_order_relaxed); }

  [[nodiscard]] capture::SourceCounters counters() const {
    return {.frames = frames_.load(std::memory_order_relaxed),
            .dropped_late = dropped_late_.load(std::memory_order_relaxed),
            .dropped_no_buffer = dropped_no_buffer_.load(std::memory_order_relaxed)};
  }
  [[nodiscard]] std::uint64_t reopened() const { return reopened_.load(std::memory_order_relaxed); }

 private:
  mutable std::mutex mutex_;
  Report report_;
  std::atomic<std::uint32_t> version_{0};
  std::atomic<std::uint64_t> frames_{0};
  std::atomic<std::uint64_t> dropped_late_{0};
  std::atomic<std::uint64_t> dropped_no_buffer_{0};
  std::atomic<std::uint64_t> reopened_{0};
};

}  // namespace waymark::daemon
