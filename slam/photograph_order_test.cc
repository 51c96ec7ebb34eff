#include "slam/photograph_order.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

// A wall with a marker every half metre, photographed from a few places along it.
class PhotographOrderTest : public ::testing::Test {
 protected:
  PhotographOrderTest() {
    options_.markers.size_m = kSize_m;
    options_.treatAsUnorderedImages();
    Transform facing;
    facing.R = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
    for (int id = 0; id < 10; ++id) {
      Transform T_w_m = facing;
      T_w_m.p = {0.5 * id, 0.1 * (id % 3), 2.0};
      T_w_m.R = facing.R * expSo3(Eigen::Vector3d(0.2 * (id % 2), 0.15 * (id % 3), 0.0));
      markers_.push_back({id, T_w_m});
    }
    for (int i = 0; i < 9; ++i) {
      Transform T_w_c;
      T_w_c.p = {0.3 + 0.5 * i, 0.05 * (i % 2), 0.1 * (i % 3)};
      LiveFrame& frame = frames_.emplace_back();
      frame.monotonic_ns = 1'000'000'000LL * i;
      frame.detections = testing::observeAll(camera_, T_w_c, markers_, kSize_m, 0.1, &rng_);
    }
  }
  // In that order. Where each marker is, as marker 0 has it.
  [[nodiscard]] std::map<int, Transform> mapOf(const std::vector<std::size_t>& order,
                                               std::size_t* placed) const {
    std::vector<LiveFrame> frames;
    for (const std::size_t i : order) {
      frames.push_back(frames_[i]);
      frames.back().monotonic_ns = 1'000'000'000LL * static_cast<std::int64_t>(frames.size());
    }
    Slam slam(camera_, *Dictionary::byName("APRILTAG_36h11"), options_);
    const auto placements = placeInOrder(frames, &slam);
    *placed = static_cast<std::size_t>(
        std::ranges::count_if(placements, [](const Placement& p) { return p.pose.has_value(); }));
    std::map<int, Transform> poses;
    const MapMarker* const first = slam.map().findPosed(0);
    if (first == nullptr) return poses;
    for (const auto& [id, marker] : slam.map().markers()) {
      if (marker.T_w_m) poses[id] = first->T_w_m->inverse() * *marker.T_w_m;
    }
    return poses;
  }

  static constexpr double kSize_m = 0.16;
  std::mt19937 rng_{3};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_;
  std::vector<LiveFrame> frames_;
  Options options_;
};

TEST_F(PhotographOrderTest, TheOrderOfTheFilesDoesNotMatter) {
  std::vector<std::size_t> order(frames_.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::size_t placed = 0;
  const auto first = mapOf(order, &placed);
  EXPECT_EQ(placed, frames_.size());
  ASSERT_EQ(first.size(), markers_.size());
  for (int shuffle = 0; shuffle < 5; ++shuffle) {
    std::ranges::shuffle(order, rng_);
    const auto other = mapOf(order, &placed);
    EXPECT_EQ(placed, frames_.size());
    ASSERT_EQ(other.size(), first.size());
    for (const auto& [id, T_0_m] : first) {
      EXPECT_LT((other.at(id).p - T_0_m.p).norm(), 1e-6) << id << ", shuffle " << shuffle;
    }
  }
}

// A picture that shows nothing of the others is told as such, and does not stop them.
TEST_F(PhotographOrderTest, WhatShowsNothingHasNoPlace) {
  frames_.emplace_back();
  std::vector<std::size_t> order(frames_.size());
  std::iota(order.rbegin(), order.rend(), std::size_t{0});
  std::size_t placed = 0;
  EXPECT_EQ(mapOf(order, &placed).size(), markers_.size());
  EXPECT_EQ(placed, frames_.size() - 1);
}

}  // namespace
}  // namespace waymark::slam
