#include "slam/initialization/two_frame.h"

#include <gtest/gtest.h>

#include "slam/testing/ambiguous_markers.h"

namespace waymark::slam {
namespace {

class TwoFrameTest : public testing::AmbiguousMarkersTest {
 protected:
  std::variant<TwoFrameStart, TwoFrameFailure> start(const std::vector<MarkerDetection>& first,
                                                     const std::vector<MarkerDetection>& second) {
    return initializeFromTwoFrames(first, second, options_, camera_.focalLength(), {});
  }
};

// What is started is right, and at the right scale; and most pairs with a good baseline start.
TEST_F(TwoFrameTest, StartsFromAmbiguousMarkersOnly) {
  constexpr int kTrials = 40;
  int started = 0;
  int flipped = 0;
  int posed = 0;
  double scale = 0.0;
  for (int i = 0; i < kTrials; ++i) {
    const Transform T_w_0 = view(-0.6);
    const Transform T_w_1 = view(0.6, 0.3);
    const auto [first, second] = ambiguousPair(T_w_0, T_w_1);
    const auto outcome = start(first, second);
    const auto* found = std::get_if<TwoFrameStart>(&outcome);
    if (found == nullptr) continue;
    ++started;
    const Transform truth = T_w_0.inverse() * T_w_1;
    scale += found->T_0_1.p.norm() / truth.p.norm();
    EXPECT_LT(rotationDistance(found->T_0_1.R, truth.R), 0.05);
    for (const InitialMarker& marker : found->markers) {
      const Transform T_0_m = T_w_0.inverse() * markers_[static_cast<std::size_t>(marker.id)].T_w_m;
      ++posed;
      if (rotationDistance(marker.T_w_m.R, T_0_m.R) > 0.15) ++flipped;
      EXPECT_LT((marker.T_w_m.p - T_0_m.p).norm(), 0.1);
    }
  }
  EXPECT_GE(started, kTrials / 2);
  EXPECT_NEAR(scale / started, 1.0, 0.02);
  EXPECT_GE(posed, 2 * started);
  // Odds of 3 and a floor of evidence are meant to leave hardly any wrong; see square_pose_test.
  EXPECT_LE(flipped, posed / 50) << "of " << posed;
}

// Whatever the baseline: a motion between either pose in the first view and either in the second
// explains one marker as well as those poses do, so two coin tosses stay two coin tosses.
TEST_F(TwoFrameTest, OneAmbiguousMarkerIsNeverEnough) {
  const auto only = markers_[1];
  markers_ = {only};
  for (int i = 0; i < 20; ++i) {
    const auto [first, second] = ambiguousPair(testing::lookAt({-0.8, 0.2, 0.3}, only.T_w_m.p),
                                               testing::lookAt({0.8, 0.2, -0.3}, only.T_w_m.p));
    ASSERT_EQ(first.size() + second.size(), 2U);
    const auto outcome = start(first, second);
    ASSERT_TRUE(std::holds_alternative<TwoFrameFailure>(outcome)) << "trial " << i;
    EXPECT_EQ(std::get<TwoFrameFailure>(outcome), TwoFrameFailure::kAmbiguous);
  }
}

TEST_F(TwoFrameTest, RejectsAShortBaseline) {
  const auto [first, second] = ambiguousPair(view(0.0), view(0.05));
  const auto outcome = start(first, second);
  ASSERT_TRUE(std::holds_alternative<TwoFrameFailure>(outcome));
  // 5 cm from 3 m away is less than the 5 % asked for.
  EXPECT_EQ(std::get<TwoFrameFailure>(outcome), TwoFrameFailure::kShortBaseline);
}

// Straight towards one frontal marker: a long baseline that does not tell left from right.
TEST_F(TwoFrameTest, RejectsWhatStaysAmbiguous) {
  const Transform T_w_m = testing::markerFacing({0.0, 3.0, 0.0}, {0.0, 0.0, 0.0});
  for (int i = 0; i < 20; ++i) {
    const auto a = testing::observe(camera_, view(0.0, -1.0), 1, T_w_m, kSize, 0.3, &rng_);
    const auto b = testing::observe(camera_, view(0.0, -0.5), 1, T_w_m, kSize, 0.3, &rng_);
    ASSERT_TRUE(a && b);
    const auto outcome = start({*a}, {*b});
    ASSERT_TRUE(std::holds_alternative<TwoFrameFailure>(outcome)) << "trial " << i;
    EXPECT_EQ(std::get<TwoFrameFailure>(outcome), TwoFrameFailure::kAmbiguous);
  }
}

// Half of the markers hang elsewhere in the second view: no motion explains both halves.
TEST_F(TwoFrameTest, RejectsViewsThatContradictEachOther) {
  const auto first = ambiguousPair(view(-0.6), view(-0.6)).first;
  for (std::size_t i = 0; i < 3; ++i) markers_[i].T_w_m.p.x() += 0.3;
  const auto second = ambiguousPair(view(0.6, 0.3), view(0.6, 0.3)).first;
  const auto outcome = start(first, second);
  ASSERT_TRUE(std::holds_alternative<TwoFrameFailure>(outcome));
  EXPECT_EQ(std::get<TwoFrameFailure>(outcome), TwoFrameFailure::kPoorFit);
}

// The options have half of the markers at twice their size. As the camera keeps them all in the
// middle, a short motion explains both halves nearly; but it must not pass.
TEST_F(TwoFrameTest, DoesNotStartWithWrongSizes) {
  for (int i = 0; i < 20; ++i) {
    options_.other_sizes = {};
    const auto [first, second] = ambiguousPair(view(-0.6), view(0.6, 0.3));
    options_.other_sizes = {{{0, 2}, 2.0 * kSize}};
    EXPECT_TRUE(std::holds_alternative<TwoFrameFailure>(start(first, second))) << "trial " << i;
  }
}

TEST_F(TwoFrameTest, MarkersInOneFrameOnlyDoNotTakePart) {
  auto [first, second] = ambiguousPair(view(-0.6), view(0.6, 0.3));
  std::erase_if(first, [](const MarkerDetection& d) { return d.id == 0; });
  std::erase_if(second, [](const MarkerDetection& d) { return d.id == 5; });
  const auto outcome = start(first, second);
  if (const auto* found = std::get_if<TwoFrameStart>(&outcome)) {
    for (const InitialMarker& marker : found->markers) {
      EXPECT_NE(marker.id, 0);
      EXPECT_NE(marker.id, 5);
    }
  }
  std::erase_if(first, [](const MarkerDetection& d) { return d.id >= 3; });
  std::erase_if(second, [](const MarkerDetection& d) { return d.id < 3; });
  for (const auto& nothing : {start(first, second), start({}, second), start(first, {})}) {
    ASSERT_TRUE(std::holds_alternative<TwoFrameFailure>(nothing));
    EXPECT_EQ(std::get<TwoFrameFailure>(nothing), TwoFrameFailure::kNoCommonMarker);
  }
}

TEST_F(TwoFrameTest, DegenerateCornersAreLeftOut) {
  auto [first, second] = ambiguousPair(view(-0.6), view(0.6, 0.3));
  for (auto& corner : first[0].normalized) corner = first[0].normalized[0];
  const auto outcome = start(first, second);
  if (const auto* found = std::get_if<TwoFrameStart>(&outcome)) {
    for (const InitialMarker& marker : found->markers) EXPECT_NE(marker.id, first[0].id);
  }
  const std::vector<MarkerDetection> only = {first[0]};
  EXPECT_EQ(std::get<TwoFrameFailure>(start(only, second)), TwoFrameFailure::kNoCommonMarker);
}

}  // namespace
}  // namespace waymark::slam
