// Steady tracking takes no memory from the heap: neither detection nor SLAM, with a counting
// operator new.
#include <cstdint>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/detection/search/marker_follower.h"
#include "slam/natural/filter/testing_textured_wall.h"
#include "slam/slam.h"
#include "slam/testing/counting_new.h"
#include "slam/testing/drawn_marker.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

using testing::kFramePeriodNs;
using waymark::testing::allocations;

constexpr double kSize = 0.12;

// Of what `use` does.
template <typename Use>
int allocationsOf(const Use& use) {
  const int before = allocations;
  use();
  return allocations - before;
}

TEST(Allocation, IsCounted) {
  const int count = allocationsOf([] {
    std::vector<int> values(1000);
    volatile int* const first = values.data();
    *first = 1;
  });
  EXPECT_EQ(count, 1);
}

// A picture of eight markers that moves to and fro.
TEST(Allocation, FollowingTakesNone) {
  const CameraModel camera(testing::testCalibration());
  const Dictionary dictionary = *Dictionary::byName("APRILTAG_36h11");
  std::vector<testing::Picture> pictures;
  for (int phase = 0; phase < 4; ++phase) {
    testing::Picture& picture = pictures.emplace_back(camera.width(), camera.height(), 200);
    for (int i = 0; i < 8; ++i) {
      testing::drawMarker(dictionary, i, 40 + 140 * (i % 4) + phase, 60 + 180 * (i / 4) + phase,
                          4 + i, i % 4, &picture);
    }
  }
  MarkerFollower follower(camera, dictionary, {}, {});
  const auto find = [&](int frame) {
    const int phase = frame % 8 < 4 ? frame % 8 : 7 - frame % 8;
    EXPECT_EQ(
        follower.find(pictures[static_cast<std::size_t>(phase)].view(), frame * kFramePeriodNs, {})
            .size(),
        8U);
  };
  int frame = 0;
  for (; frame < 60; ++frame) find(frame);
  EXPECT_EQ(follower.mode(), SearchMode::kFollowing);
  EXPECT_EQ(allocationsOf([&] {
              for (; frame < 180; ++frame) find(frame);
            }),
            0);
}

// A camera before a wall of markers; with and without mapping.
class SteadyTracking : public ::testing::TestWithParam<bool> {};

TEST_P(SteadyTracking, TakesNone) {
  std::mt19937 rng(4);
  const CameraModel camera(testing::testCalibration());
  const auto markers = testing::markerWall(3, 6, 0.4, &rng);
  const auto poseAt = [](int frame) {
    const double s = 0.02 * std::sin(0.1 * frame);
    return testing::lookAt({s, 0.0, 0.1}, {s, 3.0, 0.0});
  };
  std::vector<Transform> views;
  for (int i = -3; i <= 3; ++i)
    views.push_back(testing::lookAt({0.2 * i, 0.1, 0.0}, {0.1 * i, 3.0, 0.0}));
  Options options;
  options.markers.size_m = kSize;
  options.mapping = GetParam();
  Slam slam(camera, *Dictionary::byName("APRILTAG_36h11"), options,
            testing::trueMap(camera, views, markers, kSize, 0.05, &rng));
  std::vector<std::vector<MarkerDetection>> seen;
  for (int frame = 0; frame < 300; ++frame) {
    seen.push_back(testing::observeAll(camera, poseAt(frame), markers, kSize, 0.05, &rng));
  }
  const auto feed = [&](int frame) {
    const auto result =
        slam.process({.time = {static_cast<std::uint64_t>(frame), frame * kFramePeriodNs},
                      .detections = seen[static_cast<std::size_t>(frame)]});
    EXPECT_TRUE(result.pose) << describe(result.reason);
    return result.keyframe_added;
  };
  int frame = 0;
  for (; frame < 100; ++frame) (void)feed(frame);
  slam.finish();
  const auto keyframes = slam.map().keyframes().size();
  EXPECT_EQ(allocationsOf([&] {
              for (; frame < 300; ++frame) (void)feed(frame);
            }),
            0);
  EXPECT_EQ(slam.map().keyframes().size(), keyframes) << "not steady";
}

// The only marker has been out of view for half a second; features carry the pose.
TEST(Allocation, BridgingTakesNone) {
  constexpr double kRate_hz = 30.0;
  constexpr double kMarker_m = 0.3;
  constexpr int kWithMarker = 45;
  constexpr int kSteady = 60;
  constexpr int kFrames = 120;
  std::mt19937 rng(1);
  const CameraModel camera(testing::wideCalibration(320, 240));
  testing::TexturedWall wall(3);
  const testing::Dolly dolly{.speed_m_per_s = 0.4, .seed = 1};
  const Transform T_w_m = testing::markerFacing({0.0, -0.005, 0.1}, {-0.6, -1.0, 0.1});
  Options options;
  options.markers.size_m = kMarker_m;
  Slam slam(camera, *Dictionary::byName("4X4_50"), options);
  std::vector<std::uint8_t> pixels;
  int taken = 0;
  int bridged = 0;
  for (int k = 0; k < kFrames; ++k) {
    const Transform T_w_c = dolly.at(k / kRate_hz);
    wall.render(camera, T_w_c, 2.0, static_cast<unsigned>(k), &pixels);
    std::vector<MarkerDetection> seen;
    if (k < kWithMarker) {
      const auto detection = testing::observe(camera, T_w_c, 7, T_w_m, kMarker_m, 0.06, &rng);
      ASSERT_TRUE(detection);
      seen = {*detection};
    }
    if (k == kSteady) slam.finish();
    const ImageView image{pixels.data(), camera.width(), camera.height(), camera.width()};
    FrameResult result;
    const int count = allocationsOf([&] {
      result = slam.process(
          {.time = {static_cast<std::uint64_t>(k), static_cast<std::int64_t>(1e9 * k / kRate_hz)},
           .image = image,
           .detections = seen});
    });
    if (k < kSteady) continue;
    taken += count;
    bridged += result.pose && result.pose->source == PoseSource::kNaturalFeatures ? 1 : 0;
  }
  EXPECT_EQ(taken, 0);
  EXPECT_EQ(bridged, kFrames - kSteady) << "not what was to be measured";
}

INSTANTIATE_TEST_SUITE_P(Modes, SteadyTracking, ::testing::Bool(),
                         [](const auto& test) { return test.param ? "Mapping" : "LocalizeOnly"; });

}  // namespace
}  // namespace waymark::slam
