// When a picture was taken, from what its driver says.
#pragma once

#include <cstdint>

namespace waymark::capture {

struct DriverTime {
  enum class Meaning {
    kStartOfExposure,
    kEndOfFrame,  // when the last pixel came
    kNothing,     // of no known clock
  };
  std::int64_t ns = 0;  // CLOCK_MONOTONIC, unless kNothing
  Meaning meaning = Meaning::kNothing;
};

struct MidExposure {
  std::int64_t monotonic_ns = 0;
  bool on_arrival = false;  // the driver's time said nothing: reckoned from when it came
};

// exposure_ns: 0 when unknown; then half an exposure is not accounted for. A time that is not
// within the second before `arrival_ns` is not of CLOCK_MONOTONIC, whatever the driver says.
[[nodiscard]] MidExposure midExposure(const DriverTime& time, std::int64_t exposure_ns,
                                      std::int64_t arrival_ns);

}  // namespace waymark::capture
