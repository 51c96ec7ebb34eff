// Plays a recording as if a camera were taking it now.
#pragma once

#include <memory>
#include <optional>

#include "capture/frame_source.h"

namespace waymark::capture {

// Hands each frame of `recording` out when it is due: at its recorded distance from the first one,
// or every 1 / rate_hz seconds where that is given. Frames are stamped with the CLOCK_MONOTONIC and
// wall-clock time they were due at, so that a consumer's latency includes the source's lateness;
// the sequence counts them all. A frame that is more than a period late when it could be handed out
// is dropped and counted in dropped_late. The clock starts at the first read().
[[nodiscard]] std::unique_ptr<FrameSource> playInRealTime(std::unique_ptr<FrameSource> recording,
                                                          std::optional<double> rate_hz);

}  // namespace waymark::capture
