#include "slam/detection/search/border_entry_detector.h"

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr int kWidth = 320;
constexpr int kHeight = 240;
constexpr int kReach = 40;

// A light scene with a dark square in it.
class Scene {
 public:
  [[nodiscard]] ImageView with(int left, int top, int size) {
    std::ranges::fill(pixels_, std::uint8_t{180});
    for (int y = std::max(top, 0); y < std::min(top + size, kHeight); ++y) {
      for (int x = std::max(left, 0); x < std::min(left + size, kWidth); ++x) {
        pixels_[static_cast<std::size_t>(y * kWidth + x)] = 30;
      }
    }
    return view();
  }
  [[nodiscard]] ImageView noise(double sigma, std::mt19937* rng) {
    std::normal_distribution<double> level(128.0, sigma);
    for (std::uint8_t& pixel : pixels_) pixel = static_cast<std::uint8_t>(level(*rng));
    return view();
  }

 private:
  [[nodiscard]] ImageView view() const { return {pixels_.data(), kWidth, kHeight, kWidth}; }
  std::vector<std::uint8_t> pixels_ = std::vector<std::uint8_t>(std::size_t{kWidth} * kHeight);
};

bool covers(std::span<const SearchRegion> schedule, int left, int top, int size) {
  return std::ranges::any_of(schedule, [&](const SearchRegion& region) {
    const Window& w = region.window;
    return size <= kReach * region.factor && left >= w.left && top >= w.top &&
           left + size <= w.left + w.width && top + size <= w.top + w.height;
  });
}

struct Entrance {
  const char* name;
  int left, top;       // in the first frame
  int step_x, step_y;  // per frame
};

class BorderEntryDetectorEntrance : public ::testing::TestWithParam<Entrance> {};

// In the frame in which a square is two pixels within the image, or the next.
TEST_P(BorderEntryDetectorEntrance, IsNoticedAtOnce) {
  for (const int size : {12, 30, 60, 120}) {
    const Entrance& entrance = GetParam();
    BorderEntryDetector screening(kWidth, kHeight, 4, kReach);
    Scene scene;
    int left = entrance.left == 0 ? -size : entrance.left;
    int top = entrance.top == 0 ? -size : entrance.top;
    int frames_whole = 0;
    bool noticed = false;
    while (!noticed && frames_whole < 2 * 4) {
      noticed = covers(screening.next(scene.with(left, top, size)), left, top, size);
      const bool whole =
          left >= 2 && top >= 2 && left + size <= kWidth - 2 && top + size <= kHeight - 2;
      if (whole) ++frames_whole;
      left += entrance.step_x;
      top += entrance.step_y;
    }
    // The larger it is, the coarser the pixels that it has to leave.
    EXPECT_TRUE(noticed) << size;
    EXPECT_LE(frames_whole, size <= kReach ? 1 : 3) << size;
  }
}

INSTANTIATE_TEST_SUITE_P(Borders, BorderEntryDetectorEntrance,
                         ::testing::Values(Entrance{"left", 0, 60, 3, 0},
                                           Entrance{"right", kWidth, 60, -3, 0},
                                           Entrance{"top", 90, 0, 0, 3},
                                           Entrance{"bottom", 90, kHeight, 0, -3},
                                           Entrance{"diagonal", 0, 60, 3, 1}),
                         [](const auto& test) { return test.param.name; });

TEST(BorderEntryDetector, NothingEntersAStillScene) {
  BorderEntryDetector screening(kWidth, kHeight, 4, kReach);
  Scene scene;
  (void)screening.next(scene.with(-10, 60, 40));
  EXPECT_TRUE(screening.next(scene.with(-10, 60, 40)).empty());
  EXPECT_TRUE(screening.next(scene.with(-13, 60, 40)).empty());  // leaves
}

TEST(BorderEntryDetector, NoiseIsWorthLittle) {
  std::mt19937 rng(1);
  BorderEntryDetector screening(kWidth, kHeight, 4, kReach);
  Scene scene;
  double pixels = 0.0;
  constexpr int kFrames = 20;
  for (int frame = 0; frame < kFrames; ++frame) {
    for (const SearchRegion& region : screening.next(scene.noise(5.0, &rng))) {
      EXPECT_LE(region.window.left + region.window.width, kWidth);
      EXPECT_LE(region.window.top + region.window.height, kHeight);
      pixels += static_cast<double>(region.window.width) * region.window.height /
                (region.factor * region.factor);
    }
  }
  EXPECT_LT(pixels / kFrames, 0.05 * kWidth * kHeight);
}

}  // namespace
}  // namespace waymark::slam
