// The clocks of the outside world, and that of a thread's work. The SLAM itself has none.
#pragma once

#include <chrono>
#include <cstdint>
#include <ctime>

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

// CLOCK_THREAD_CPUTIME_ID, nanoseconds that the calling thread has run: what a piece of work costs,
// however busy the machine is.
[[nodiscard]] inline std::int64_t threadCpuNs() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1'000'000'000 * static_cast<std::int64_t>(time.tv_sec) + time.tv_nsec;
}

}  // namespace waymark
