// Which frame, and when.
#pragma once

#include <cstdint>

namespace waymark::slam {

struct FrameTime {
  std::uint64_t sequence = 0;
  std::int64_t monotonic_ns = 0;  // mid-exposure
};

}  // namespace waymark::slam
