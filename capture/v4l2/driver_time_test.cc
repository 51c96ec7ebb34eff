#include "capture/v4l2/driver_time.h"

#include <cstdint>

#include <gtest/gtest.h>

namespace waymark::capture::v4l2 {
namespace {

constexpr std::int64_t kMs_ns = 1'000'000;
constexpr std::int64_t kExposure_ns = 8 * kMs_ns;
constexpr std::int64_t kArrival_ns = 50'000 * kMs_ns;
const timeval kStamp{.tv_sec = 49, .tv_usec = 980'000};  // 20 ms before it arrived
constexpr std::int64_t kStamp_ns = 49'980 * kMs_ns;

MidExposure ofFlags(std::uint32_t flags) {
  return midExposure(driverTime(flags, kStamp), kExposure_ns, kArrival_ns);
}

TEST(DriverTime, StartOfExposureIsMovedOn) {
  const MidExposure mid = ofFlags(V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE);
  EXPECT_EQ(mid.monotonic_ns, kStamp_ns + 4 * kMs_ns);
  EXPECT_FALSE(mid.on_arrival);
}

TEST(DriverTime, EndOfFrameIsMovedBack) {
  const MidExposure mid = ofFlags(V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_EOF);
  EXPECT_EQ(mid.monotonic_ns, kStamp_ns - 4 * kMs_ns);
  EXPECT_FALSE(mid.on_arrival);
}

TEST(DriverTime, TimesOfNoKnownClockGiveWayToTheArrival) {
  for (const std::uint32_t flags :
       {V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN, V4L2_BUF_FLAG_TIMESTAMP_COPY}) {
    const MidExposure mid = ofFlags(flags);
    EXPECT_EQ(mid.monotonic_ns, kArrival_ns - 4 * kMs_ns);
    EXPECT_TRUE(mid.on_arrival);
  }
}

// Some drivers say "monotonic" of the wall clock.
TEST(DriverTime, ImpossibleTimesGiveWayToTheArrival) {
  for (const std::int64_t ns : {kArrival_ns + 1, kArrival_ns - 1001 * kMs_ns,
                                std::int64_t{1'700'000'000} * 1000 * kMs_ns}) {
    const DriverTime time{.ns = ns, .meaning = DriverTime::Meaning::kEndOfFrame};
    EXPECT_TRUE(midExposure(time, kExposure_ns, kArrival_ns).on_arrival);
  }
}

}  // namespace
}  // namespace waymark::capture::v4l2
