#include "daemon/frames/stage_clock.h"

#include <atomic>
#include <chrono>
#include <cstdint>
#include <string>
#include <thread>

#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

using std::chrono::milliseconds;

void spend(StageClock& clock, slam::Stage stage, int ms) {
  clock.begin(stage);
  std::this_thread::sleep_for(milliseconds(ms));
  clock.end(stage);
}

TEST(StageClock, NamesTheLongestStage) {
  StageClock clock;
  clock.beginFrame();
  spend(clock, slam::Stage::kMap, 10);
  spend(clock, slam::Stage::kDetect, 15);
  spend(clock, slam::Stage::kTrack, 1);
  spend(clock, slam::Stage::kMap, 10);
  EXPECT_GE(clock.endFrame(), 36'000'000);
  EXPECT_EQ(clock.longest(), static_cast<std::size_t>(slam::Stage::kMap)) << "its parts add up";
  EXPECT_EQ(std::string(kFrameStages[clock.longest()].name), "map");
}

TEST(StageClock, TimeOutsideTheStagesHasAName) {
  StageClock clock;
  clock.beginFrame();
  spend(clock, slam::Stage::kDetect, 30);
  (void)clock.endFrame();
  clock.beginFrame();
  spend(clock, slam::Stage::kTrack, 1);
  std::this_thread::sleep_for(milliseconds(10));
  (void)clock.endFrame();
  EXPECT_EQ(clock.longest(), kOtherStage) << "the frame before is forgotten";
}

TEST(StageClock, EveryStepIsASignOfLife) {
  std::atomic<std::int64_t> alive_ns{0};
  StageClock clock(&alive_ns);
  clock.beginFrame();
  auto isNewer = [&, before_ns = std::int64_t{0}]() mutable {
    std::this_thread::sleep_for(milliseconds(1));
    const bool newer = alive_ns > before_ns;
    before_ns = monotonicNs();
    return newer;
  };
  clock.begin(slam::Stage::kDetect);
  EXPECT_TRUE(isNewer());
  clock.advance();
  EXPECT_TRUE(isNewer());
  EXPECT_FALSE(isNewer());
  clock.end(slam::Stage::kDetect);
  EXPECT_TRUE(isNewer());
}

}  // namespace
}  // namespace waymark::daemon
