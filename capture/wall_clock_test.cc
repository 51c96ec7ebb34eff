#include "capture/wall_clock.h"

#include <cstdint>
#include <cstdlib>

#include <gtest/gtest.h>

#include "base/clock.h"

namespace waymark::capture {
namespace {

constexpr std::int64_t kMs_ns = 1'000'000;
constexpr std::int64_t kSecond_ns = 1000 * kMs_ns;
constexpr std::int64_t kEpoch_ns = 1'700'000'000 * kSecond_ns;

// Reads as update() does, with clocks that say what the test wants.
void observe(WallClock& clock, std::int64_t monotonic_ns, std::int64_t offset_ns,
             std::int64_t early_ns = 500, std::int64_t late_ns = 500) {
  clock.observe(monotonic_ns - early_ns, monotonic_ns + offset_ns, monotonic_ns + late_ns);
}

TEST(WallClock, TellsTheTimeOfTheSystem) {
  WallClock clock;
  clock.update();
  const std::int64_t before_us = wallUs();
  const std::int64_t utime = clock.utime(monotonicNs());
  const std::int64_t after_us = wallUs();
  EXPECT_GT(utime, before_us - 2000);
  EXPECT_LT(utime, after_us + 2000);
}

TEST(WallClock, FollowsAStepAtOnceBothWays) {
  WallClock clock;
  const std::int64_t hour_ns = 3600 * kSecond_ns;
  std::int64_t now = 5 * kSecond_ns;
  for (const std::int64_t offset : {kEpoch_ns, kEpoch_ns + hour_ns, kEpoch_ns - hour_ns}) {
    for (int i = 0; i < 3; ++i) {
      now += 10 * kMs_ns;
      observe(clock, now, offset);
      EXPECT_EQ(clock.utime(now), (now + offset) / 1000);
    }
  }
}

TEST(WallClock, FollowsASlew) {
  WallClock clock;
  std::int64_t offset = kEpoch_ns;
  std::int64_t now = kSecond_ns;
  for (int i = 0; i < 600; ++i) {
    now += 33 * kMs_ns;
    offset += 16'500;  // 500 ppm, as fast as NTP goes
    observe(clock, now, offset);
  }
  const std::int64_t told_us = clock.utime(now);
  const std::int64_t true_us = (now + offset) / 1000;
  EXPECT_LE(std::abs(told_us - true_us), 300);
}

// Between the two readings of CLOCK_MONOTONIC the thread had to wait: the wall clock was read at
// one of their ends, not in the middle.
TEST(WallClock, ATornReadingChangesNothing) {
  WallClock clock;
  const std::int64_t now = kSecond_ns;
  observe(clock, now, kEpoch_ns);
  const std::int64_t before = clock.utime(now);
  observe(clock, now, kEpoch_ns, 20 * kMs_ns, 0);
  observe(clock, now, kEpoch_ns, 0, 20 * kMs_ns);
  EXPECT_EQ(clock.utime(now), before);
}

}  // namespace
}  // namespace waymark::capture
