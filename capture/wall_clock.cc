#include "capture/wall_clock.h"

#include <ctime>

#include "base/clock.h"

namespace waymark::capture {
namespace {

// A reading torn further apart than this says too little.
constexpr std::int64_t kTorn_ns = 200'000;
constexpr int kReadings = 8;  // of an update, until one is whole
// NTP slews by at most half a millisecond in a second: what is further off has been set.
constexpr std::int64_t kStep_ns = 2'000'000;
constexpr std::int64_t kAveraged = 16;  // readings

std::int64_t wallNs() {
  timespec time{};
  clock_gettime(CLOCK_REALTIME, &time);
  return 1'000'000'000 * static_cast<std::int64_t>(time.tv_sec) + time.tv_nsec;
}

}  // namespace

void WallClock::update() {
  for (int i = 1;; ++i) {
    const std::int64_t before = monotonicNs();
    const std::int64_t wall = wallNs();
    const std::int64_t after = monotonicNs();
    if (after - before < kTorn_ns || i == kReadings) return observe(before, wall, after);
  }
}

void WallClock::observe(std::int64_t monotonic_before_ns, std::int64_t wall_ns,
                        std::int64_t monotonic_after_ns) {
  const std::int64_t width = monotonic_after_ns - monotonic_before_ns;
  const std::int64_t offset = wall_ns - (monotonic_before_ns + width / 2);
  const std::int64_t change = offset - offset_ns_;
  const bool stepped = change > kStep_ns + width || change < -kStep_ns - width;
  if (!known_ || stepped) {
    offset_ns_ = offset;
    known_ = true;
  } else if (width < kTorn_ns) {
    offset_ns_ += change / kAveraged;
  }
}

}  // namespace waymark::capture
