#include "slam/detection/search/scan_schedule.h"

#include <array>
#include <cstdint>
#include <map>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr int kWidth = 640;
constexpr int kHeight = 480;

// Whether a square of so many pixels is whole in a part searched at that factor or a finer one.
bool covers(const SearchRegion& region, int x, int y, int size, int factor) {
  const Window& w = region.window;
  return region.factor <= factor && x >= w.left && y >= w.top && x + size <= w.left + w.width &&
         y + size <= w.top + w.height;
}

// How many frames it takes until the square is searched whole.
int framesUntilSeen(ScanSchedule* schedule, double interval_s, int x, int y, int size, int factor,
                    int least_frames = 1) {
  for (int frame = 1; frame <= 1000; ++frame) {
    for (const SearchRegion& region : schedule->next(interval_s, least_frames)) {
      if (covers(region, x, y, size, factor)) return frame;
    }
  }
  return 1000;
}

TEST(ScanSchedule, EveryPlaceHasItsTurnInTime) {
  constexpr double kInterval_s = 1.0 / 60.0;
  constexpr int kRound = 6;
  for (int x = 0; x + 200 <= kWidth; x += 55) {
    for (int y = 0; y + 200 <= kHeight; y += 70) {
      ScanSchedule schedule(kWidth, kHeight);
      EXPECT_LE(framesUntilSeen(&schedule, kInterval_s, x, y, 80, 2), kRound) << x << ' ' << y;
      EXPECT_LE(framesUntilSeen(&schedule, kInterval_s, x, y, 200, 4), 2 * kRound);
      EXPECT_LE(framesUntilSeen(&schedule, kInterval_s, x, y, 40, 1),
                (ScanScheduleOptions{}.small_rounds + 1) * kRound);
    }
  }
}

TEST(ScanSchedule, PartsLieWithinTheImageAndAreAFractionOfIt) {
  ScanSchedule schedule(kWidth, kHeight);
  constexpr int kFrames = 120;
  std::int64_t all_pixels = 0;
  for (int frame = 0; frame < kFrames; ++frame) {
    int pixels = 0;
    for (const SearchRegion& region : schedule.next(1.0 / 60.0)) {
      const Window& w = region.window;
      EXPECT_GE(w.left, 0);
      EXPECT_GE(w.top, 0);
      EXPECT_LE(w.left + w.width, kWidth);
      EXPECT_LE(w.top + w.height, kHeight);
      pixels += w.width * w.height / (region.factor * region.factor);
    }
    EXPECT_LT(pixels, kWidth * kHeight * 2 / 3) << frame;
    all_pixels += pixels;
  }
  EXPECT_LT(all_pixels / kFrames, kWidth * kHeight * 2 / 5);
}

// However rarely they come.
TEST(ScanSchedule, ABusyImageIsSpreadOverSoManyFrames) {
  constexpr int kLeast = 6;
  for (const double interval_s : {1.0 / 30.0, 0.2, 0.5}) {
    ScanSchedule schedule(kWidth, kHeight);
    for (int frame = 0; frame < 50; ++frame) {
      double pixels = 0.0;
      for (const SearchRegion& region : schedule.next(interval_s, kLeast)) {
        pixels += searchedPixels(region);
      }
      EXPECT_LT(pixels, kWidth * kHeight / 3) << interval_s;
    }
    for (int x = 0; x + 40 <= kWidth; x += 60) {
      EXPECT_LE(framesUntilSeen(&schedule, interval_s, x, 200, 40, 1, kLeast), 2 * kLeast + 2);
      EXPECT_LE(framesUntilSeen(&schedule, interval_s, x / 2, 200, 80, 2, kLeast), kLeast + 1);
    }
  }
}

// Also where frames, or nothing, says how many a round has.
TEST(ScanSchedule, EachPartKnowsHowOftenItWasSearched) {
  for (const double interval_s : {0.5, 1.0 / 60.0, 0.0}) {
    ScanSchedule schedule(kWidth, kHeight);
    std::map<std::array<int, 3>, std::uint32_t> turns;  // by place and factor
    for (int frame = 0; frame < 1200; ++frame) {
      for (const SearchRegion& region : schedule.next(interval_s)) {
        const std::array place{region.window.left, region.window.top, region.factor};
        EXPECT_EQ(region.turn, turns[place]++) << interval_s;
      }
    }
    for (const auto& [place, times] : turns) EXPECT_GT(times, 1U);
  }
}

// At frames that far apart there is no time for turns.
TEST(ScanSchedule, RareFramesAreSearchedAsAWhole) {
  ScanSchedule schedule(kWidth, kHeight);
  const auto due = schedule.next(0.5);
  ASSERT_EQ(due.size(), 1U);
  EXPECT_TRUE(covers(due[0], 0, 0, kHeight, 1));
  EXPECT_EQ(due[0].window.width, kWidth);
}

}  // namespace
}  // namespace waymark::slam
