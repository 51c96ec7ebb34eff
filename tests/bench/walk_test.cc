#include "tests/bench/walk.h"

#include <algorithm>
#include <set>

#include <gtest/gtest.h>

#include "simulator/observed_corners.h"

namespace waymark::bench {
namespace {

double jump_m(const Walk& walk, std::size_t from) {
  const std::size_t to = (from + 1) % walk.frames.size();
  return (walk.frames[to].T_w_c.p - walk.frames[from].T_w_c.p).norm();
}

// Every marker comes into view, some are always in view, and the way closes without a jump.
TEST(Walk, HallShowsAllItsMarkers) {
  const Walk hall = walkThroughHall(1);
  const slam::CameraModel camera(hall.camera);
  EXPECT_EQ(hall.markers.size(), 2000U);
  std::set<int> seen;
  std::size_t fewest = 100;
  for (std::size_t k = 0; k < hall.frames.size(); k += 10) {
    const Walk::Frame& frame = hall.frames[k];
    const auto detections = simulator::observeCorners(camera, frame.T_w_c, frame.in_view, k, {});
    fewest = std::min(fewest, detections.size());
    for (const auto& detection : detections) seen.insert(detection.id);
  }
  EXPECT_EQ(seen.size(), 2000U);
  EXPECT_GE(fewest, 3U);
  for (std::size_t k = 0; k < hall.frames.size(); ++k) ASSERT_LT(jump_m(hall, k), 0.12) << k;
}

TEST(Walk, ScenesCloseTheirLoop) {
  const auto walls = planWalk({.scene = "walls", .seed = 2, .loop_s = 60.0});
  ASSERT_TRUE(walls.ok()) << walls.error().message;
  EXPECT_EQ(walls->frames.size(), 3600U);
  EXPECT_EQ(walls->markers.size(), 48U);
  for (std::size_t k = 0; k < walls->frames.size(); ++k) {
    ASSERT_LT(jump_m(*walls, k), 0.03) << k;
    ASSERT_FALSE(walls->frames[k].in_view.empty()) << k;
  }
  EXPECT_FALSE(planWalk({.scene = "cellar"}).ok());
}

}  // namespace
}  // namespace waymark::bench
