// From CLOCK_MONOTONIC to the wall clock, while somebody sets the latter.
#pragma once

#include <cstdint>

namespace waymark::capture {

// Keeps the distance between the two clocks. Between steps of the wall clock it changes only as
// fast as NTP slews, so that single readings, which the scheduler may have torn apart, are
// averaged; a step is followed at once.
class WallClock {
 public:
  // Reads both clocks. To be called often, such as once a frame.
  void update();

  // One reading: the wall clock, nanoseconds since 1970, between two readings of CLOCK_MONOTONIC.
  void observe(std::int64_t monotonic_before_ns, std::int64_t wall_ns,
               std::int64_t monotonic_after_ns);

  // The wall clock's time, microseconds since 1970, at a time of CLOCK_MONOTONIC.
  // Precondition: there was an update() or observe().
  [[nodiscard]] std::int64_t utime(std::int64_t monotonic_ns) const {
    return (monotonic_ns + offset_ns_) / 1000;
  }

 private:
  bool known_ = false;
  std::int64_t offset_ns_ = 0;  // wall clock - CLOCK_MONOTONIC
};

}  // namespace waymark::capture
