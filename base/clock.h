// The two clocks of the outside world. The SLAM itself has none.
#pragma once

#include <chrono>
#include <cstdint>

namespace waymark {

// CLOCK_MONOTONIC, nanoseconds: the clock of frame stamps, so that differences are latencies.
[[nodiscard]] inline std::int64_t monotonicNs() {
  using namespace std::chrono;
  return duration_cast<nanoseconds>(steady_clock::now().time_since_epoch()).count();
}

// Wall clock, microseconds since 1970: the utime of messages.
[[nodiscard]] inline std::int64_t wallUs() {
  using namespace std::chrono;
  return duration_cast<microseconds>(system_clock::now().time_since_epoch()).count();
}

}  // namespace waymark
