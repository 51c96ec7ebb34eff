// What is asked of a camera. What it cannot give is rejected with one line that says what it can,
// or, where another choice does as well, given as a warning with the source.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <variant>

namespace waymark::capture {

// A number, a switch, or the name of a menu's entry.
using ControlValue = std::variant<std::int64_t, double, bool, std::string>;

struct CameraOptions {
  // FourCC ("GREY", "YUYV", "MJPG", ...); empty: the cheapest that reaches the rate.
  std::string format;
  // Pixels; 0: the largest that reaches the rate.
  int width = 0;
  int height = 0;
  double rate_hz = 0.0;  // 0: as fast as the camera goes at that size
  // The driver's. Each frame that waits or is worked on holds one, and the camera needs two.
  int buffers = 4;
  // Keep the JPEG of a camera that compresses beside the grey picture, for a recording.
  bool keep_jpeg = false;

  // Fixed exposure time, seconds. Unset: whatever `controls` and the camera make of it.
  std::optional<double> exposure_s;
  // By their names at the driver ("gain", "power_line_frequency", ...).
  std::map<std::string, ControlValue> controls;

  bool operator==(const CameraOptions&) const = default;
};

}  // namespace waymark::capture
