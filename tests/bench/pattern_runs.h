// What frames full of a pattern cost, beside ordinary ones, and how soon markers in front of it are
// found.
#pragma once

#include <cstdint>
#include <optional>

namespace waymark::bench {

struct PatternRunOptions {
  int width = 640;
  int height = 480;
  int frames = 45;  // of each kind
  double rate_hz = 30.0;
  // Each frame's time is the shortest of so many: what else the computer does is not the
  // detector's.
  int repeats = 3;
  std::uint64_t seed = 1;
};

// Prints a table. False when some frame is not within its bound or some marker was not found in
// time; empty when the ordinary scene cannot be rendered.
[[nodiscard]] std::optional<bool> runPatterns(const PatternRunOptions& options);

}  // namespace waymark::bench
