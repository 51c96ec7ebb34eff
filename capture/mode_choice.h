// Which of a camera's formats, sizes and rates to take.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"
#include "capture/camera_options.h"

namespace waymark::capture {

// A size that a camera offers in a format, or a range of them.
struct OfferedMode {
  std::uint32_t fourcc = 0;
  // Pixels; from min to max in steps. A single size has min == max.
  int min_width = 0, max_width = 0, width_step = 1;
  int min_height = 0, max_height = 0, height_step = 1;
  // Hz, fastest first; empty when the camera does not say.
  std::vector<double> rates_hz;
};

struct ChosenMode {
  std::uint32_t fourcc = 0;
  int width = 0;                      // pixels
  int height = 0;                     // pixels
  double rate_hz = 0.0;               // 0 when the camera does not say
  std::vector<std::string> warnings;  // what of the options it is not
};

// What was asked for and is not there is an error that lists what is: format and size. The rate is
// the slowest that is fast enough, or else the fastest, with a warning. Among what does, the
// cheapest format wins; among equals the first offered.
[[nodiscard]] Result<ChosenMode> chooseMode(std::span<const OfferedMode> offered,
                                            const CameraOptions& asked);

// "1280x720 at 30, 15 Hz", "16x16 to 1920x1080 in steps of 2x2 pixels".
[[nodiscard]] std::string describeSize(const OfferedMode& mode);

}  // namespace waymark::capture
