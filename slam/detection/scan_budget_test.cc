// How much is looked at in an image that is full of dark things.
#include "slam/detection/scan_budget.h"

#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "slam/detection/quads/quad_scanner.h"
#include "slam/detection/search/marker_follower.h"
#include "slam/testing/drawn_marker.h"

namespace waymark::slam {
namespace {

constexpr std::int64_t kFrameAt30Hz_ns = 33'333'333;
constexpr int kHalfASecond = 15;  // frames

// A perforated panel: squares of 8 pixels, 10 from one to the next.
testing::Picture panel(int width, int height) {
  testing::Picture picture(width, height, 210);
  picture.paint(30, [](int x, int y) { return x % 10 < 8 && y % 10 < 8; });
  return picture;
}

TEST(QuadScanner, ComparesQuadsWithTheirNeighboursOnly) {
  const testing::Picture picture = panel(1280, 720);
  QuadScanner scanner;
  const QuadScan scan = scanner.scan(picture.view());
  ASSERT_GT(scan.quads.size(), 8000U);
  EXPECT_FALSE(scan.too_busy);
  EXPECT_EQ(scan.deferred_regions, 0);
  // Both thresholds find each of them; all with all would be 40 million.
  EXPECT_LT(scan.compared, 4 * static_cast<int>(scan.quads.size()));
}

TEST(QuadScanner, FitsNoMoreRegionsThanItIsAllowed) {
  const testing::Picture picture = panel(640, 480);
  QuadScanner scanner;
  const QuadScan all = scanner.scan(picture.view());
  const QuadScan some = scanner.scan(picture.view(), 0, {.regions = 100});
  EXPECT_EQ(some.regions, 100);
  EXPECT_EQ(some.deferred_regions, all.regions - 100);
  EXPECT_LE(some.quads.size(), 100U);
  const QuadScan none = scanner.scan(picture.view(), 0, {.runs = 10'000});
  EXPECT_TRUE(none.too_busy);
  EXPECT_EQ(none.regions, 0);
}

class ScanBudgetTest : public ::testing::Test {
 protected:
  struct Placed {
    int id;
    int left;
    int top;
    int cell_px;
  };

  // With its light margin.
  void draw(const Placed& marker, testing::Picture* picture) const {
    const int margin = marker.cell_px;
    const int side = marker.cell_px * dictionary_.cells();
    picture->paint(210, [&](int x, int y) {
      return x >= marker.left - margin && x < marker.left + side + margin &&
             y >= marker.top - margin && y < marker.top + side + margin;
    });
    testing::drawMarker(dictionary_, marker.id, marker.left, marker.top, marker.cell_px, 0,
                        picture);
  }
  std::size_t show(const testing::Picture& picture) {
    before_ = follower_.work();
    return follower_.find(picture.view(), ++frame_ * kFrameAt30Hz_ns, {}).size();
  }
  // In the last frame.
  [[nodiscard]] std::uint64_t candidates() const {
    return follower_.work().candidates - before_.candidates;
  }
  [[nodiscard]] std::uint64_t futileFits() const {
    return follower_.work().futile_fits - before_.futile_fits;
  }
  [[nodiscard]] std::uint64_t regions() const { return follower_.work().regions - before_.regions; }
  // Of a frame, with what searches may look at however small they are.
  void expectWithinBudget() const {
    constexpr int kSearches = 8;
    const ScanBudgetOptions options;
    const ScanBudget most = ScanBudget::ofFrame(options, camera_.width(), camera_.height());
    EXPECT_LE(candidates(),
              static_cast<std::uint64_t>(most.candidates + kSearches * options.least_candidates))
        << frame_;
    EXPECT_LE(regions(),
              static_cast<std::uint64_t>(most.regions + kSearches * options.least_regions))
        << frame_;
    EXPECT_LE(futileFits(),
              static_cast<std::uint64_t>(most.futile_fits + kSearches * options.least_fits))
        << frame_;
  }

  CameraModel camera_{Calibration{
      .width = 1280, .height = 720, .fx = 1000.0, .fy = 1000.0, .cx = 639.5, .cy = 359.5}};
  Dictionary dictionary_ = *Dictionary::byName("ARUCO_MIP_36h12");
  MarkerFollower follower_{camera_, dictionary_, {}, {}};
  ScanWork before_;
  int frame_ = 0;
};

TEST_F(ScanBudgetTest, APanelIsSearchedInTurnsWithinTheBudget) {
  const testing::Picture picture = panel(1280, 720);
  for (int i = 0; i < 60; ++i) {
    EXPECT_EQ(show(picture), 0U);
    EXPECT_EQ(follower_.mode(), SearchMode::kInTurns);
    expectWithinBudget();
  }
  EXPECT_GT(follower_.work().deferred, 0U);
}

TEST_F(ScanBudgetTest, MarkersBeforeAPanelAreFoundSoonAndFollowed) {
  testing::Picture picture = panel(1280, 720);
  draw({3, 300, 200, 6}, &picture);
  draw({4, 900, 500, 3}, &picture);
  int frames = 0;
  for (; show(picture) < 2 && frames < 100; ++frames) expectWithinBudget();
  EXPECT_LE(frames, kHalfASecond);
  for (int i = 0; i < 30; ++i) {
    EXPECT_EQ(show(picture), 2U) << i;
    EXPECT_EQ(follower_.mode(), SearchMode::kFollowing);
    expectWithinBudget();
  }
  draw({5, 120, 560, 4}, &picture);
  for (frames = 0; show(picture) < 3 && frames < 100; ++frames) expectWithinBudget();
  EXPECT_LE(frames, kHalfASecond);
}

// Windows with bars have a border, and no code: edges of many are fitted in vain.
TEST_F(ScanBudgetTest, MarkersBeforeAFacadeAreFoundSoonAndFollowed) {
  testing::Picture facade(1280, 720, 210);
  facade.paint(30, [](int x, int y) {
    const int column = x % 36;
    const int row = y % 48;
    const bool bar = column / 2 == 8 || (x / 36 % 2 == 0 && row / 2 == 12 && column > 8);
    return column >= 6 && column < 30 && row >= 6 && row < 42 && !bar;
  });
  for (int i = 0; i < kHalfASecond; ++i) {
    EXPECT_EQ(show(facade), 0U);
    expectWithinBudget();
  }
  EXPECT_GT(follower_.work().futile_fits, 0U);
  draw({3, 300, 200, 6}, &facade);
  draw({4, 900, 500, 3}, &facade);
  int frames = 0;
  for (; show(facade) < 2 && frames < 100; ++frames) expectWithinBudget();
  EXPECT_LE(frames, kHalfASecond);
  for (int i = 0; i < 30; ++i) {
    EXPECT_EQ(show(facade), 2U) << i;
    expectWithinBudget();
  }
}

// What is followed may disappear all at once, as behind a hand with a grille.
TEST_F(ScanBudgetTest, ManyMarkersThatAreGoneAreLookedForWithinTheBudget) {
  testing::Picture picture = panel(1280, 720);
  for (int i = 0; i < 40; ++i) draw({i, 60 + 120 * (i % 10), 60 + 150 * (i / 10), 5}, &picture);
  for (int i = 0; i < 2 * kHalfASecond; ++i) (void)show(picture);
  EXPECT_EQ(show(picture), 40U);
  (void)show(panel(1280, 720));
  const ScanBudgetOptions options;
  const ScanBudget most = ScanBudget::ofFrame(options, camera_.width(), camera_.height());
  EXPECT_LE(candidates(),
            static_cast<std::uint64_t>(2 * most.candidates + 44 * options.least_candidates));
}

TEST_F(ScanBudgetTest, OnceThePanelIsGoneTheWholeImageIsScannedAgain) {
  const testing::Picture busy = panel(1280, 720);
  for (int i = 0; i < 5; ++i) (void)show(busy);
  testing::Picture wall(1280, 720, 210);
  draw({3, 300, 200, 6}, &wall);
  int frames = 0;
  while (show(wall) == 0 && frames < 100) ++frames;
  EXPECT_LE(frames, kHalfASecond);
  const testing::Picture empty(1280, 720, 210);
  for (int i = 0; i < kHalfASecond; ++i) (void)show(empty);
  EXPECT_EQ(follower_.mode(), SearchMode::kFullScan);
}

TEST_F(ScanBudgetTest, OrdinaryFramesLeaveNothingForLater) {
  testing::Picture wall(1280, 720, 210);
  for (int i = 0; i < 40; ++i) draw({i, 60 + 120 * (i % 10), 60 + 150 * (i / 10), 5}, &wall);
  for (int i = 0; i < 30; ++i) EXPECT_EQ(show(wall), 40U) << i;
  EXPECT_EQ(follower_.work().deferred, 0U);
}

// Recordings of photographs have no later frames.
TEST_F(ScanBudgetTest, WithoutFollowingEverythingIsLookedAt) {
  FollowerOptions options;
  options.enabled = false;
  MarkerFollower scanner(camera_, dictionary_, {}, options);
  testing::Picture picture = panel(1280, 720);
  draw({3, 300, 200, 6}, &picture);
  EXPECT_EQ(scanner.find(picture.view(), kFrameAt30Hz_ns, {}).size(), 1U);
  EXPECT_EQ(scanner.mode(), SearchMode::kFullScan);
  EXPECT_EQ(scanner.work().deferred, 0U);
  EXPECT_GT(scanner.work().candidates, 8000U);
}

TEST_F(ScanBudgetTest, TheSameFramesGiveTheSame) {
  testing::Picture picture = panel(1280, 720);
  draw({3, 300, 200, 6}, &picture);
  MarkerFollower other(camera_, dictionary_, {}, {});
  for (int i = 0; i < 40; ++i) {
    const std::size_t found = show(picture);
    EXPECT_EQ(other.find(picture.view(), frame_ * kFrameAt30Hz_ns, {}).size(), found) << i;
    EXPECT_EQ(other.work().candidates, follower_.work().candidates) << i;
    EXPECT_EQ(other.work().deferred, follower_.work().deferred) << i;
  }
}

// A scan that takes long says that it gets on.
TEST_F(ScanBudgetTest, TheObserverSeesEveryStep) {
  class Steps final : public StageObserver {
   public:
    void begin(Stage /*stage*/) override {}
    void end(Stage /*stage*/) override {}
    void advance() override { ++count; }
    std::uint64_t count = 0;
  };
  Steps steps;
  (void)follower_.find(panel(1280, 720).view(), kFrameAt30Hz_ns, {}, &steps);
  EXPECT_GT(steps.count, follower_.work().candidates);
}

}  // namespace
}  // namespace waymark::slam
