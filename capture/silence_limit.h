// How long a camera may be silent until it counts as failed.
#pragma once

#include <algorithm>
#include <chrono>

namespace waymark::capture {

struct SilenceOptions {
  // Of a camera of any usual rate: hiccups of a bus and of a busy computer end earlier.
  std::chrono::milliseconds least{2000};
  // A frame that is lost, and one that comes late.
  double frames = 3.0;
  // However slow it is said to be.
  std::chrono::milliseconds most{3'600'000};
};

// rate_hz, exposure_s: as asked for or as they are; 0 where nobody says. Whichever makes frames
// come more slowly counts.
[[nodiscard]] inline std::chrono::milliseconds silenceLimit(double rate_hz, double exposure_s,
                                                            const SilenceOptions& options) {
  const double interval_s = std::max(rate_hz > 0.0 ? 1.0 / rate_hz : 0.0, exposure_s);
  const double most_ms = static_cast<double>(options.most.count());
  const double slow_ms = std::min(1e3 * options.frames * interval_s, most_ms);
  return std::max(options.least, std::chrono::milliseconds(static_cast<long>(slow_ms)));
}

}  // namespace waymark::capture
