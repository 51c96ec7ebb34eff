#include "tests/vm/wall_clock_steps.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <iterator>

#include <gtest/gtest.h>

#include "base/clock.h"
#include "tests/vm/service_fixture.h"

namespace waymark::testing {
namespace {

std::int64_t wallMinusMonotonic_us() {
  timespec wall{};
  clock_gettime(CLOCK_REALTIME, &wall);
  return 1'000'000LL * wall.tv_sec + wall.tv_nsec / 1000 - monotonicNs() / 1000;
}

void stepWallClock(std::int64_t by_s) {
  timespec wall{};
  clock_gettime(CLOCK_REALTIME, &wall);
  wall.tv_sec += by_s;
  ASSERT_EQ(clock_settime(CLOCK_REALTIME, &wall), 0);
}

}  // namespace

std::vector<Stage> stepBackAndForth(const Subscriber& subscriber) {
  std::vector<Stage> stages;
  for (const std::int64_t by_s : {0, 3600, -7200, 3600}) {
    stepWallClock(by_s);
    stages.push_back({monotonicNs(), wallMinusMonotonic_us()});
    const std::size_t frames = subscriber.received().framePoses().size();
    const auto enough = [&](const Received& r) { return r.framePoses().size() >= frames + 10; };
    EXPECT_TRUE(subscriber.waitFor(enough, kPatience)) << "after a step by " << by_s << " s";
  }
  return stages;
}

std::vector<pose_t> framesSince(const Subscriber& subscriber, std::int64_t begin_ns) {
  std::vector<pose_t> frames = subscriber.received().framePoses();
  std::erase_if(frames, [&](const pose_t& frame) { return frame.monotonic_ns < begin_ns; });
  return frames;
}

void expectNoneMissingUncounted(const Subscriber& subscriber) {
  const auto later_health = [](const Received& r) {
    return !r.framePoses().empty() &&
           r.healths.back().monotonic_ns > r.framePoses().back().monotonic_ns;
  };
  EXPECT_TRUE(subscriber.waitFor(later_health, kPatience));
  const Received received = subscriber.received();
  const std::vector<pose_t> frames = received.framePoses();
  const std::int64_t missing = frames.back().sequence - frames.front().sequence + 1 -
                               static_cast<std::int64_t>(frames.size());
  std::int64_t counted = 0;
  for (const auto& [name, value] : received.counters()) {
    if (name.starts_with("dropped.")) counted += value;
  }
  std::cout << missing << " of " << frames.size() << " frames missing, " << counted << " counted\n";
  EXPECT_LE(missing, counted);
  EXPECT_LT(missing, static_cast<std::int64_t>(frames.size()) / 4);
}

void expectTimesOf(const std::vector<Stage>& stages, const std::vector<pose_t>& frames) {
  // A frame that is under way when the clock is set may have either time.
  constexpr std::int64_t kUnderWay_ns = 500'000'000;
  std::size_t compared = 0;
  for (const pose_t& frame : frames) {
    const auto next = std::ranges::find_if(
        stages, [&](const Stage& stage) { return stage.begin_ns > frame.monotonic_ns; });
    const Stage& stage = *std::prev(next);
    if (frame.monotonic_ns < stage.begin_ns + kUnderWay_ns) continue;
    if (next != stages.end() && frame.monotonic_ns > next->begin_ns - kUnderWay_ns) continue;
    const std::int64_t wall_minus_monotonic_us = frame.utime - frame.monotonic_ns / 1000;
    ASSERT_LT(std::abs(wall_minus_monotonic_us - stage.wall_minus_monotonic_us), 50'000)
        << "of frame " << frame.sequence;
    ++compared;
  }
  EXPECT_GE(compared, 5U);
}

}  // namespace waymark::testing
