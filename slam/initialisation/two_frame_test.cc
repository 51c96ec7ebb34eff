#include "slam/initialisation/two_frame.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/initialisation/initialiser.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.1;
constexpr double kNoisePx = 0.15;

// Small markers 3 m away that nearly face the camera: some 17 pixels wide, every single view of
// them is ambiguous.
class TwoFrameTest : public ::testing::Test {
 protected:
  TwoFrameTest() {
    std::uniform_real_distribution<double> u(-1.0, 1.0);
    for (int i = 0; i < 6; ++i) {
      const Eigen::Vector3d centre(0.4 * (i % 3 - 1), 3.0 + 0.1 * u(rng_), 0.4 * (i / 3) - 0.2);
      const Eigen::Vector3d towards = centre + Eigen::Vector3d(0.25 * u(rng_), -1, 0.25 * u(rng_));
      markers_.push_back({i, testing::markerFacing(centre, towards)});
    }
    options_.size_m = kSize;
  }

  static Transform view(double x_m, double y_m = 0.0) {
    return testing::lookAt({x_m, y_m, 0.0}, {0.0, 3.0, 0.0});
  }

  std::vector<MarkerDetection> observe(const Transform& T_w_c) {
    return testing::observeAll(camera_, T_w_c, markers_, kSize, kNoisePx, &rng_);
  }

  std::variant<TwoFrameStart, TwoFrameFailure> start(const std::vector<MarkerDetection>& first,
                                                     const std::vector<MarkerDetection>& second) {
    return initialiseFromTwoFrames(first, second, options_, camera_.focalLength(), {});
  }

  bool allAmbiguous(const std::vector<MarkerDetection>& detections) {
    return initialiseFromOneFrame(detections, options_, camera_.focalLength(), 3.0, {}).empty();
  }

  // The first pair of views, of many with other noise, that is ambiguous throughout.
  using Pair = std::pair<std::vector<MarkerDetection>, std::vector<MarkerDetection>>;
  Pair ambiguousPair(const Transform& T_w_0, const Transform& T_w_1) {
    for (int i = 0; i < 1000; ++i) {
      Pair pair{observe(T_w_0), observe(T_w_1)};
      if (allAmbiguous(pair.first) && allAmbiguous(pair.second)) return pair;
    }
    ADD_FAILURE() << "the views are not ambiguous";
    return {};
  }

  // Keyframe of the initialiser.
  static Keyframe frame(std::vector<MarkerDetection> detections) {
    return {-1, 0, 0, {}, std::move(detections)};
  }

  std::mt19937 rng_{21};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_;
  MarkerOptions options_;
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

TEST_F(TwoFrameTest, OneAmbiguousMarkerCanBeEnough) {
  // By turning round it the camera sees it from both sides of its normal.
  const Transform T_w_0 = testing::lookAt({-1.3, 0.6, 0.3}, markers_[1].T_w_m.p);
  const Transform T_w_1 = testing::lookAt({1.3, 0.6, -0.3}, markers_[1].T_w_m.p);
  const Transform truth = T_w_0.inverse() * T_w_1;
  int started = 0;
  for (int i = 0; i < 40; ++i) {
    const auto a = testing::observe(camera_, T_w_0, 1, markers_[1].T_w_m, kSize, kNoisePx, &rng_);
    const auto b = testing::observe(camera_, T_w_1, 1, markers_[1].T_w_m, kSize, kNoisePx, &rng_);
    ASSERT_TRUE(a && b);
    const auto outcome = start({*a}, {*b});
    const auto* found = std::get_if<TwoFrameStart>(&outcome);
    if (found == nullptr) continue;
    ++started;
    EXPECT_LT(rotationDistance(found->T_0_1.R, truth.R), 0.2);
  }
  // From a single marker the motion is ambiguous in itself; a start is welcome, a wrong one is not.
  RecordProperty("started", started);
}

TEST_F(TwoFrameTest, RefusesAShortBaseline) {
  const auto [first, second] = ambiguousPair(view(0.0), view(0.05));
  const auto outcome = start(first, second);
  ASSERT_TRUE(std::holds_alternative<TwoFrameFailure>(outcome));
  // 5 cm from 3 m away is less than the 5 % asked for.
  EXPECT_EQ(std::get<TwoFrameFailure>(outcome), TwoFrameFailure::kShortBaseline);
}

// Straight towards one frontal marker: a long baseline that does not tell left from right.
TEST_F(TwoFrameTest, RefusesWhatStaysAmbiguous) {
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
TEST_F(TwoFrameTest, RefusesViewsThatContradictEachOther) {
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
  for (auto& corner : first[0].normalised) corner = first[0].normalised[0];
  const auto outcome = start(first, second);
  if (const auto* found = std::get_if<TwoFrameStart>(&outcome)) {
    for (const InitialMarker& marker : found->markers) EXPECT_NE(marker.id, first[0].id);
  }
  const std::vector<MarkerDetection> only = {first[0]};
  EXPECT_EQ(std::get<TwoFrameFailure>(start(only, second)), TwoFrameFailure::kNoCommonMarker);
}

TEST_F(TwoFrameTest, TheInitialiserStartsFromOneFrameWhereItCan) {
  Initialiser initialiser(options_, camera_.focalLength(), {});
  EXPECT_FALSE(initialiser.process(frame({})));
  EXPECT_STREQ(initialiser.reason(), "no marker in view");
  const Transform near = testing::lookAt({0.9, 2.4, 0.4}, markers_[4].T_w_m.p);
  auto seen = testing::observe(camera_, near, 4, markers_[4].T_w_m, kSize, 0.05, &rng_);
  ASSERT_TRUE(seen);
  Keyframe keyframe = frame({*seen});
  keyframe.T_w_c.p = {7.0, 7.0, 7.0};  // not looked at
  const auto start = initialiser.process(keyframe);
  ASSERT_TRUE(start);
  ASSERT_EQ(start->keyframes.size(), 1U);
  EXPECT_EQ(start->keyframes[0].T_w_c.p, Eigen::Vector3d::Zero());
  ASSERT_EQ(start->markers.size(), 1U);
  EXPECT_LT((start->markers[0].T_w_m.p - (near.inverse() * markers_[4].T_w_m).p).norm(), 0.01);
}

TEST_F(TwoFrameTest, TheInitialiserStartsFromTwoFrames) {
  const Transform T_w_0 = view(-0.6);
  const Transform T_w_1 = view(0.6, 0.3);
  Initialiser initialiser(options_, camera_.focalLength(), {});
  EXPECT_FALSE(initialiser.process(frame(ambiguousPair(T_w_0, T_w_1).first)));
  std::optional<Start> found;
  for (int i = 0; i < 20 && !found; ++i) {
    found = initialiser.process(frame(ambiguousPair(T_w_0, T_w_1).second));
  }
  ASSERT_TRUE(found) << initialiser.reason();
  ASSERT_EQ(found->keyframes.size(), 2U);
  EXPECT_EQ(found->keyframes[0].T_w_c.p, Eigen::Vector3d::Zero());
  EXPECT_LT((found->keyframes[1].T_w_c.p - (T_w_0.inverse() * T_w_1).p).norm(), 0.1);
}

// After n frames in vain, f^0 is the newest one: a frame 1.2 m from the first f^0 but right beside
// the new one finds no baseline any more.
TEST_F(TwoFrameTest, TheInitialiserReplacesItsFirstFrame) {
  constexpr int kAttempts = 5;
  const auto [far_left, far_right] = ambiguousPair(view(-0.6), view(0.6, 0.3));
  const auto beside = [&](double x_m) { return ambiguousPair(view(x_m), view(x_m)).first; };
  InitialisationOptions options;
  options.attempts = kAttempts;
  Initialiser initialiser(options_, camera_.focalLength(), options);
  EXPECT_FALSE(initialiser.process(frame(beside(-0.6))));
  for (int i = 0; i < kAttempts; ++i) {
    EXPECT_FALSE(initialiser.process(frame(beside(-0.6)))) << i;
    EXPECT_STREQ(initialiser.reason(),
                 "all markers in view are ambiguous; move the camera sideways or closer");
  }
  EXPECT_FALSE(initialiser.process(frame(far_right))) << "becomes f^0";
  EXPECT_FALSE(initialiser.process(frame(ambiguousPair(view(0.6, 0.3), view(0.6, 0.3)).first)))
      << "with the old f^0 this one would start";
  EXPECT_STREQ(initialiser.reason(),
               "all markers in view are ambiguous; move the camera sideways or closer");
}

TEST_F(TwoFrameTest, TheInitialiserSaysWhy) {
  auto [first, second] = ambiguousPair(view(-0.6), view(0.6, 0.3));
  const auto reasonFor = [&](const std::vector<MarkerDetection>& b) {
    Initialiser initialiser(options_, camera_.focalLength(), {});
    EXPECT_FALSE(initialiser.process(frame(first)));
    EXPECT_FALSE(initialiser.process(frame(b)));
    return std::string(initialiser.reason());
  };
  auto others = second;
  for (auto& detection : others) detection.id += 100;
  EXPECT_NE(reasonFor(others).find("none is shared"), std::string::npos);
  for (std::size_t i = 0; i < 3; ++i) markers_[i].T_w_m.p.x() += 0.3;
  const auto elsewhere = ambiguousPair(view(0.6, 0.3), view(0.6, 0.3)).first;
  EXPECT_NE(reasonFor(elsewhere).find("contradict"), std::string::npos);
}

}  // namespace
}  // namespace waymark::slam
