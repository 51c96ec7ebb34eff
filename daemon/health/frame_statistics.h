// Rates and latencies of the frames since the last health message.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include <waymark/health_t.hpp>

namespace waymark::daemon {

class FrameStatistics {
 public:
  void add(bool localized, std::int64_t latency_ns, std::int64_t processing_ns);

  // Fills in the rates and times of the period since the last call, and begins a new one.
  void report(std::int64_t now_ns, health_t& message);

 private:
  // More than a second of the fastest cameras. Beyond, samples are left out of the quantiles only.
  static constexpr std::size_t kMaxSamples = 2048;

  std::int64_t begin_ns_ = 0;  // monotonic; 0 before the first report
  std::size_t frames_ = 0;
  std::size_t localized_ = 0;
  std::array<std::int64_t, kMaxSamples> latency_ns_{};
  std::array<std::int64_t, kMaxSamples> processing_ns_{};
};

}  // namespace waymark::daemon
