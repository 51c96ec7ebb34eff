// How the camera is doing, as the capture thread reports it and the publisher tells the world.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
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
    for (std::size_t i = 0; i < counters_.size(); ++i) {
      counters_[i].store(total.*capture::kSourceCounters[i].value, std::memory_order_relaxed);
    }
  }
  [[nodiscard]] capture::SourceCounters counters() const {
    capture::SourceCounters total;
    for (std::size_t i = 0; i < counters_.size(); ++i) {
      total.*capture::kSourceCounters[i].value = counters_[i].load(std::memory_order_relaxed);
    }
    return total;
  }

  void countReopened() { reopened_.fetch_add(1, std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t reopened() const { return reopened_.load(std::memory_order_relaxed); }
  // Given up because nothing came from it for too long.
  void countSilence() { silences_.fetch_add(1, std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t silences() const { return silences_.load(std::memory_order_relaxed); }

  // Frames a second, nominal, of the camera as it is open now; 0 when it does not say.
  void setRate(double rate_hz) { rate_hz_.store(rate_hz, std::memory_order_relaxed); }
  [[nodiscard]] double rateHz() const { return rate_hz_.load(std::memory_order_relaxed); }
  // Of the options, how much is not as it was asked for.
  void setRejected(std::uint64_t count) { rejected_.store(count, std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t rejected() const { return rejected_.load(std::memory_order_relaxed); }

 private:
  mutable std::mutex mutex_;
  Report report_;
  std::atomic<std::uint32_t> version_{0};
  std::array<std::atomic<std::uint64_t>, capture::kSourceCounters.size()> counters_{};
  std::atomic<std::uint64_t> reopened_{0};
  std::atomic<std::uint64_t> silences_{0};
  std::atomic<std::uint64_t> rejected_{0};
  std::atomic<double> rate_hz_{0.0};
};

}  // namespace waymark::daemon
