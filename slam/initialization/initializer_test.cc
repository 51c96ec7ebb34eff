#include "slam/initialization/initializer.h"

#include <string>

#include <gtest/gtest.h>

#include "slam/testing/ambiguous_markers.h"

namespace waymark::slam {
namespace {

class InitializerTest : public testing::AmbiguousMarkersTest {
 protected:
  static Keyframe frame(std::vector<MarkerDetection> detections) {
    return {-1, 0, 0, {}, std::move(detections)};
  }
};

TEST_F(InitializerTest, StartsFromOneFrameWhereItCan) {
  Initializer initializer(options_, camera_.focalLength(), {});
  EXPECT_FALSE(initializer.process(frame({})));
  EXPECT_EQ(initializer.reason(), NoPoseReason::kNoMarker);
  const Transform near = testing::lookAt({0.9, 2.4, 0.4}, markers_[4].T_w_m.p);
  auto seen = testing::observe(camera_, near, 4, markers_[4].T_w_m, kSize, 0.05, &rng_);
  ASSERT_TRUE(seen);
  Keyframe keyframe = frame({*seen});
  keyframe.T_w_c.p = {7.0, 7.0, 7.0};  // not looked at
  const auto start = initializer.process(keyframe);
  ASSERT_TRUE(start);
  ASSERT_EQ(start->keyframes.size(), 1U);
  EXPECT_EQ(start->keyframes[0].T_w_c.p, Eigen::Vector3d::Zero());
  ASSERT_EQ(start->markers.size(), 1U);
  EXPECT_LT((start->markers[0].T_w_m.p - (near.inverse() * markers_[4].T_w_m).p).norm(), 0.01);
}

TEST_F(InitializerTest, StartsFromTwoFrames) {
  const Transform T_w_0 = view(-0.6);
  const Transform T_w_1 = view(0.6, 0.3);
  Initializer initializer(options_, camera_.focalLength(), {});
  EXPECT_FALSE(initializer.process(frame(ambiguousPair(T_w_0, T_w_1).first)));
  std::optional<Start> found;
  for (int i = 0; i < 20 && !found; ++i) {
    found = initializer.process(frame(ambiguousPair(T_w_0, T_w_1).second));
  }
  ASSERT_TRUE(found) << describe(initializer.reason());
  ASSERT_EQ(found->keyframes.size(), 2U);
  EXPECT_EQ(found->keyframes[0].T_w_c.p, Eigen::Vector3d::Zero());
  EXPECT_LT((found->keyframes[1].T_w_c.p - (T_w_0.inverse() * T_w_1).p).norm(), 0.1);
}

// After n frames in vain, f^0 is the newest one: a frame 1.2 m from the first f^0 but right beside
// the new one finds no baseline any more.
TEST_F(InitializerTest, ReplacesItsFirstFrame) {
  constexpr int kAttempts = 5;
  const auto [far_left, far_right] = ambiguousPair(view(-0.6), view(0.6, 0.3));
  const auto beside = [&](double x_m) { return ambiguousPair(view(x_m), view(x_m)).first; };
  InitializationOptions options;
  options.attempts = kAttempts;
  Initializer initializer(options_, camera_.focalLength(), options);
  EXPECT_FALSE(initializer.process(frame(beside(-0.6))));
  for (int i = 0; i < kAttempts; ++i) {
    EXPECT_FALSE(initializer.process(frame(beside(-0.6)))) << i;
    EXPECT_EQ(initializer.reason(), NoPoseReason::kShortBaseline);
  }
  EXPECT_FALSE(initializer.process(frame(far_right))) << "becomes f^0";
  EXPECT_FALSE(initializer.process(frame(ambiguousPair(view(0.6, 0.3), view(0.6, 0.3)).first)))
      << "with the old f^0 this one would start";
  EXPECT_EQ(initializer.reason(), NoPoseReason::kShortBaseline);
}

TEST_F(InitializerTest, SaysWhy) {
  auto [first, second] = ambiguousPair(view(-0.6), view(0.6, 0.3));
  const auto reasonFor = [&](const std::vector<MarkerDetection>& b) {
    Initializer initializer(options_, camera_.focalLength(), {});
    EXPECT_FALSE(initializer.process(frame(first)));
    EXPECT_FALSE(initializer.process(frame(b)));
    return initializer.reason();
  };
  auto others = second;
  for (auto& detection : others) detection.id += 100;
  EXPECT_EQ(reasonFor(others), NoPoseReason::kNoneShared);
  for (std::size_t i = 0; i < 3; ++i) markers_[i].T_w_m.p.x() += 0.3;
  const auto elsewhere = ambiguousPair(view(0.6, 0.3), view(0.6, 0.3)).first;
  EXPECT_EQ(reasonFor(elsewhere), NoPoseReason::kViewsContradict);
}

}  // namespace
}  // namespace waymark::slam
