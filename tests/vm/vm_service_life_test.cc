// Ends and beginnings: the watchdog, stops, maps that are kept.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "base/clock.h"
#include "tests/process.h"
#include "tests/subscriber.h"
#include "tests/vm/inside_call.h"
#include "tests/vm/service_fixture.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;

constexpr double kStopped_s = 2.0;  // from `systemctl stop` to the end of the process

// Stops the service, which saves its map, and returns how long that took.
double stop_s() {
  fs::remove(kMap);
  EXPECT_EQ(runProgram({"systemctl", "stop", kUnit}).exit_code, 0);
  EXPECT_EQ(property("Result"), "success");
  EXPECT_TRUE(fs::exists(kMap)) << journal();
  const double stopped_s =
      1e-6 * static_cast<double>(std::stoll(property("InactiveEnterTimestampMonotonic")) -
                                 std::stoll(property("ActiveExitTimestampMonotonic")));
  std::cout << "stopped within " << stopped_s << " s\n";
  return stopped_s;
}

TEST_F(ServiceTest, TheWatchdogRestartsItWhenTheSlamLoopHangs) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  const std::string process = property("MainPID");
  const std::string restarts = property("NRestarts");
  std::string result;
  {
    StoppedThread slam(threadNamed(std::stoi(process), "wm-slam"));
    ASSERT_TRUE(slam.held());
    const std::int64_t begin_ns = monotonicNs();
    const auto over = [&] { return monotonicNs() - begin_ns > 1'000'000LL * kPatience.count(); };
    while (property("NRestarts") == restarts && !over()) {
      slam.takeNote();
      if (result.empty() || result == "success") result = property("Result");
    }
    std::cout << "restarted " << 1e-9 * static_cast<double>(monotonicNs() - begin_ns)
              << " s after the SLAM loop was stopped\n";
  }
  EXPECT_EQ(property("NRestarts"), std::to_string(std::stoi(restarts) + 1));
  EXPECT_EQ(result, "watchdog");
  EXPECT_TRUE(posesCome(3, *subscriber_)) << journal();
  EXPECT_NE(property("MainPID"), process);
  EXPECT_EQ(countOf("the SLAM loop hangs", journal()), 1U);
}

double nearest_m(const pose_t& pose, const std::vector<pose_t>& others) {
  double nearest = 1e9;
  for (const pose_t& other : others) {
    nearest =
        std::min(nearest, std::hypot(pose.p_w_c[0] - other.p_w_c[0], pose.p_w_c[1] - other.p_w_c[1],
                                     pose.p_w_c[2] - other.p_w_c[2]));
  }
  return nearest;
}

std::vector<pose_t> localized(const Subscriber& subscriber) {
  std::vector<pose_t> poses = subscriber.received().poses;
  std::erase_if(poses, [](const pose_t& pose) { return pose.source != pose_t::SOURCE_MARKERS; });
  return poses;
}

TEST_F(ServiceTest, StoppedItSavesItsMapAndStartedAgainItIsThere) {
  // An emulated processor on a busy computer may take longer now and then, but not always.
  constexpr int kAttempts = 3;
  std::vector<pose_t> before;
  double stopped_s = kStopped_s;
  for (int attempt = 0; attempt < kAttempts && stopped_s >= kStopped_s; ++attempt) {
    ASSERT_NO_FATAL_FAILURE(ensureRunning());
    ASSERT_TRUE(posesCome(20, *subscriber_));  // twice round
    before = localized(*subscriber_);
    stopped_s = stop_s();
  }
  EXPECT_LT(stopped_s, kStopped_s);

  // Without making a map of its own it can only be somewhere in that one.
  write(
      kConfiguration,
      simulated(kRate_hz, std::string("map_in = '") + kMap + "'\nlocalize_only = true\n", "TEST"));
  subscriber_.emplace(kUrl, "TEST_");
  ASSERT_EQ(runProgram({"systemctl", "start", kUnit}).exit_code, 0) << journal();
  ASSERT_TRUE(posesCome(10, *subscriber_)) << journal();
  for (const pose_t& pose : localized(*subscriber_)) {
    EXPECT_LT(nearest_m(pose, before), 0.02) << "frame " << pose.sequence;
  }
  EXPECT_EQ(runProgram({"systemctl", "stop", kUnit}).exit_code, 0);
  EXPECT_EQ(property("Result"), "success");
}

}  // namespace
}  // namespace waymark::testing
