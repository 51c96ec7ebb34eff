// What a piece of work costs, however busy the machine is.
#pragma once

#include <ctime>

namespace waymark::bench {

[[nodiscard]] inline double threadCpu_ms() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

}  // namespace waymark::bench
