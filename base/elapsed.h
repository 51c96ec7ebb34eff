// Durations as numbers: times are integer nanoseconds, what is computed with them is in seconds.
#pragma once

#include <cstdint>

namespace waymark {

// From one time of a clock to another one of the same; negative where the second is the earlier.
[[nodiscard]] inline double secondsBetween(std::int64_t from_ns, std::int64_t to_ns) {
  return 1e-9 * static_cast<double>(to_ns - from_ns);
}

}  // namespace waymark
