#include "slam/detection/search/scan_turns.h"

#include <cstdint>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr int kWidth = 640;
constexpr int kHeight = 480;

// Whether a square of so many pixels is whole in a part searched at that factor or a finer one.
bool covers(const ScanTurn& turn, int x, int y, int size, int factor) {
  const Window& w = turn.window;
  return turn.factor <= factor && x >= w.left && y >= w.top && x + size <= w.left + w.width &&
         y + size <= w.top + w.height;
}

// How many frames it takes until the square is searched whole.
int framesUntilSeen(ScanTurns* turns, double interval_s, int x, int y, int size, int factor) {
  for (int frame = 1; frame <= 1000; ++frame) {
    for (const ScanTurn& turn : turns->next(interval_s)) {
      if (covers(turn, x, y, size, factor)) return frame;
    }
  }
  return 1000;
}

TEST(ScanTurns, EveryPlaceHasItsTurnInTime) {
  constexpr double kInterval_s = 1.0 / 60.0;
  constexpr int kRound = 6;
  for (int x = 0; x + 200 <= kWidth; x += 55) {
    for (int y = 0; y + 200 <= kHeight; y += 70) {
      ScanTurns turns(kWidth, kHeight);
      EXPECT_LE(framesUntilSeen(&turns, kInterval_s, x, y, 80, 2), kRound) << x << ' ' << y;
      EXPECT_LE(framesUntilSeen(&turns, kInterval_s, x, y, 200, 4), 2 * kRound);
      EXPECT_LE(framesUntilSeen(&turns, kInterval_s, x, y, 40, 1),
                (ScanTurns::kSmallRounds + 1) * kRound);
    }
  }
}

TEST(ScanTurns, PartsLieWithinTheImageAndAreAFractionOfIt) {
  ScanTurns turns(kWidth, kHeight);
  constexpr int kFrames = 120;
  std::int64_t all_pixels = 0;
  for (int frame = 0; frame < kFrames; ++frame) {
    int pixels = 0;
    for (const ScanTurn& turn : turns.next(1.0 / 60.0)) {
      const Window& w = turn.window;
      EXPECT_GE(w.left, 0);
      EXPECT_GE(w.top, 0);
      EXPECT_LE(w.left + w.width, kWidth);
      EXPECT_LE(w.top + w.height, kHeight);
      pixels += w.width * w.height / (turn.factor * turn.factor);
    }
    EXPECT_LT(pixels, kWidth * kHeight * 2 / 3) << frame;
    all_pixels += pixels;
  }
  EXPECT_LT(all_pixels / kFrames, kWidth * kHeight * 2 / 5);
}

// At frames that far apart there is no time for turns.
TEST(ScanTurns, RareFramesAreSearchedAsAWhole) {
  ScanTurns turns(kWidth, kHeight);
  const auto due = turns.next(0.5);
  ASSERT_EQ(due.size(), 1U);
  EXPECT_TRUE(covers(due[0], 0, 0, kHeight, 1));
  EXPECT_EQ(due[0].window.width, kWidth);
}

}  // namespace
}  // namespace waymark::slam
