#include "capture/mid_exposure.h"

namespace waymark::capture {
namespace {

constexpr std::int64_t kMaxWay_ns = 1'000'000'000;

}  // namespace

MidExposure midExposure(const DriverTime& time, std::int64_t exposure_ns, std::int64_t arrival_ns) {
  const bool known = time.meaning != DriverTime::Meaning::kNothing && time.ns <= arrival_ns &&
                     time.ns > arrival_ns - kMaxWay_ns;
  if (!known) return {.monotonic_ns = arrival_ns - exposure_ns / 2, .on_arrival = true};
  const bool start = time.meaning == DriverTime::Meaning::kStartOfExposure;
  return {.monotonic_ns = time.ns + (start ? exposure_ns / 2 : -exposure_ns / 2)};
}

}  // namespace waymark::capture
