// The wall clock set forwards and back under a running service, and what its frames' times say of
// it. Guest machine only.
#pragma once

#include <cstdint>
#include <vector>

#include "tests/subscriber.h"

namespace waymark::testing {

// The wall clock as it was set.
struct Stage {
  std::int64_t begin_ns;
  std::int64_t wall_minus_monotonic_us;
};

// Sets the clock an hour forwards, an hour back, and right again, while frames come.
[[nodiscard]] std::vector<Stage> stepBackAndForth(const Subscriber& subscriber);

[[nodiscard]] std::vector<pose_t> framesSince(const Subscriber& subscriber, std::int64_t begin_ns);

// That no frame is missing but those that the daemon has counted.
void expectNoneMissingUncounted(const Subscriber& subscriber);

// That each frame's two times are as far apart as the clocks were then.
void expectTimesOf(const std::vector<Stage>& stages, const std::vector<pose_t>& frames);

}  // namespace waymark::testing
