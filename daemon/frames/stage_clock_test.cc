#include "daemon/frames/stage_clock.h"

#include <chrono>
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

}  // namespace
}  // namespace waymark::daemon
