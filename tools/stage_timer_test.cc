#include "tools/stage_timer.h"

#include <chrono>
#include <thread>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace waymark::tools {
namespace {

TEST(Summarize, PercentilesAreMeasuredTimesByNearestRank) {
  std::vector<double> times;
  for (int i = 1000; i >= 1; --i) times.push_back(i);  // any order
  const TimeSummary s = summarize(times);
  EXPECT_DOUBLE_EQ(s.mean, 500.5);
  EXPECT_DOUBLE_EQ(s.median, 500.0);
  EXPECT_DOUBLE_EQ(s.p99, 990.0);
  EXPECT_DOUBLE_EQ(s.p999, 999.0);
  EXPECT_DOUBLE_EQ(s.max, 1000.0);
}

TEST(Summarize, ShortLists) {
  EXPECT_EQ(summarize({}).max, 0.0);
  const TimeSummary one = summarize({7.0});
  EXPECT_EQ(one.median, 7.0);
  EXPECT_EQ(one.p999, 7.0);
  EXPECT_EQ(summarize({2.0, 1.0}).median, 1.0);
  EXPECT_EQ(summarize({2.0, 1.0}).p99, 2.0);
}

TEST(StageTimer, AddsUpWithinAFrameAndCountsAbsenceAsZero) {
  constexpr auto kNap = std::chrono::milliseconds(5);
  StageTimer timer;
  timer.beginFrame();
  for (int pass = 0; pass < 2; ++pass) {
    timer.begin(slam::Stage::kTrack);
    std::this_thread::sleep_for(kNap);
    timer.end(slam::Stage::kTrack);
  }
  timer.endFrame();
  timer.beginFrame();  // a frame in which nothing is tracked
  timer.endFrame();

  const nlohmann::ordered_json json = timer.json();
  const auto wall = [&](const char* stage, const char* figure) {
    return json[stage]["wall_ms"][figure].get<double>();
  };
  EXPECT_GE(wall("track", "max"), 10.0);     // both passes
  EXPECT_LT(wall("track", "median"), 10.0);  // of 0 and that
  EXPECT_GE(wall("total", "max"), wall("track", "max"));
  EXPECT_EQ(wall("detect", "max"), 0.0);
  EXPECT_EQ(wall("map", "mean"), 0.0);
  EXPECT_NEAR(timer.totalWall_ms(), 2.0 * wall("total", "mean"), 1e-9);
  // Sleeping is no work.
  EXPECT_LT(json["track"]["cpu_ms"]["max"].get<double>(), wall("track", "max"));
}

}  // namespace
}  // namespace waymark::tools
