#include "slam/camera/rolling_shutter_estimator.h"

#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/geometry/twist.h"
#include "slam/testing/rolling_views.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.12;
constexpr double kReadout_s = 0.02;
constexpr int kKeyframes = 14;

bool same(const Transform& a, const Transform& b) { return a.p == b.p && a.R == b.R; }

class RollingShutterEstimatorTest : public ::testing::Test {
 protected:
  // One more keyframe, where it truly is; what it shows is skewed.
  void addKeyframe(double speed, Map* map, double readout_s = kReadout_s) {
    std::uniform_real_distribution<double> u(-speed, speed);
    const auto i = static_cast<double>(map->keyframes().size());
    Keyframe keyframe;
    keyframe.T_w_c =
        testing::lookAt({0.2 * i - 1.3, 0.3 * std::fmod(i, 3.0), 0.15 * std::fmod(i, 2.0)},
                        {0.1 * i - 0.6, 3.0, 0.0});
    keyframe.twist << u(rng_), u(rng_), u(rng_), u(rng_), u(rng_), u(rng_);
    for (const auto& marker : markers_) {
      const auto seen = testing::observeRolling(camera_, keyframe.T_w_c, keyframe.twist, marker,
                                                kSize, readout_s, 0.1, &rng_);
      if (seen) keyframe.detections.push_back(*seen);
    }
    (void)map->addKeyframe(keyframe);
  }
  Map mapSeen(double speed, int keyframes = kKeyframes, double readout_s = kReadout_s) {
    Map map;
    for (const auto& marker : markers_) {
      (void)map.addMarker(marker.id, kSize);
      map.place(marker.id, marker.T_w_m);
    }
    for (int i = 0; i < keyframes; ++i) addKeyframe(speed, &map, readout_s);
    return map;
  }
  [[nodiscard]] RollingShutterEstimator estimator(const RollingShutterOptions& options = {}) const {
    return {options, options_};
  }
  // Slices until something is done; their number.
  int workUntilDone(const Map& map, double slice, RollingShutterEstimator* estimator) const {
    int slices = 0;
    while (!estimator->isDone() && slices < 1'000'000) {
      estimator->work(slice, camera_, map, bundle_);
      ++slices;
    }
    return slices;
  }
  std::optional<Transform> collect(Map* map, RollingShutterEstimator* estimator) const {
    return estimator->collect(camera_, bundle_, map);
  }

  std::mt19937 rng_{21};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(3, 5, 0.5, &rng_);
  MarkerOptions options_{.size_m = kSize};
  BundleOptions bundle_{.max_iterations = 30, .min_relative_decrease = 1e-8};
};

// Nobody has told it, and then it is estimated: how well it is known goes with that.
TEST_F(RollingShutterEstimatorTest, SaysHowWellItIsKnown) {
  Map map = mapSeen(0.6);
  RollingShutterEstimator learning = estimator();
  EXPECT_EQ(learning.sigma_s(), RollingShutterOptions{}.unknown_s);
  workUntilDone(map, 1000.0, &learning);
  (void)collect(&map, &learning);
  EXPECT_EQ(learning.sigma_s(), RollingShutterOptions{}.unknown_s) << "until the map follows";
  workUntilDone(map, 1000.0, &learning);
  (void)collect(&map, &learning);
  EXPECT_GT(learning.sigma_s(), 0.0);
  EXPECT_LT(std::abs(learning.seconds() - kReadout_s), 4.0 * learning.sigma_s());
  EXPECT_LT(learning.sigma_s(), kReadout_s / RollingShutterOptions{}.min_sigmas);
  EXPECT_EQ(estimator({.readout_s = 0.01}).sigma_s(), 0.0) << "given";
  EXPECT_EQ(estimator({.learned_s = 0.016}).sigma_s(), 0.002) << "of an earlier run";
}

// An estimate that is not believed says that what is in use may be off by as much.
TEST_F(RollingShutterEstimatorTest, AnEstimateThatIsNotBelievedIsADoubt) {
  Map map = mapSeen(0.6);
  RollingShutterEstimator doubting = estimator({.max_s = 0.01, .unknown_s = 0.1});
  workUntilDone(map, 1000.0, &doubting);
  EXPECT_FALSE(collect(&map, &doubting));
  EXPECT_EQ(doubting.seconds(), 0.0);
  EXPECT_NEAR(doubting.sigma_s(), kReadout_s, 0.001);
}

// First the readout time, then the whole map with corners that are corrected by it; poses and map
// are of one shutter all the while.
TEST_F(RollingShutterEstimatorTest, LearnsOverSlices) {
  Map map = mapSeen(0.6);
  const Map before = map;
  RollingShutterEstimator estimator = this->estimator();
  EXPECT_EQ(estimator.seconds(), 0.0);
  EXPECT_FALSE(estimator.idle(map)) << "it is due";
  EXPECT_FALSE(collect(&map, &estimator)) << "nothing is done yet";
  EXPECT_GT(workUntilDone(map, 20.0, &estimator), 20);
  EXPECT_EQ(estimator.seconds(), 0.0) << "not before it is collected";
  EXPECT_FALSE(collect(&map, &estimator)) << "nor before the map follows";
  EXPECT_EQ(estimator.seconds(), 0.0);
  const MarkerDetection& skewed = before.keyframes().at(3).detections.front();
  EXPECT_EQ(map.keyframes().at(3).detections.front().normalized[0], skewed.normalized[0]);

  EXPECT_FALSE(estimator.isDone());
  EXPECT_FALSE(estimator.idle(map)) << "the whole map is under way";
  const std::uint64_t epoch = map.epoch();
  const Transform T_was = map.keyframes().rbegin()->second.T_w_c;
  EXPECT_GT(workUntilDone(map, 20.0, &estimator), 20);
  const auto T_new_old = collect(&map, &estimator);
  ASSERT_TRUE(T_new_old);
  EXPECT_FALSE(same(*T_new_old, Transform{}));
  EXPECT_LT(((*T_new_old * T_was).p - map.keyframes().rbegin()->second.T_w_c.p).norm(), 1e-12);
  EXPECT_NEAR(estimator.seconds(), kReadout_s, 0.001);
  const MarkerDetection& corrected = map.keyframes().at(3).detections.front();
  EXPECT_EQ(corrected.pixels[0], skewed.pixels[0]);
  EXPECT_NE(corrected.normalized[0], skewed.normalized[0]);
  EXPECT_GT(map.epoch(), epoch) << "what is under way elsewhere is of no use any more";
  EXPECT_TRUE(estimator.idle(map));
  EXPECT_FALSE(collect(&map, &estimator));
}

TEST_F(RollingShutterEstimatorTest, SlicesChangeNothing) {
  Map map = mapSeen(0.6);
  Map other = map;
  RollingShutterEstimator in_slices = estimator();
  RollingShutterEstimator at_once = estimator();
  for (const bool moves : {false, true}) {
    (void)workUntilDone(map, 7.0, &in_slices);
    EXPECT_EQ(workUntilDone(other, kUnlimited, &at_once), 1);
    ASSERT_EQ(collect(&map, &in_slices).has_value(), moves);
    ASSERT_EQ(collect(&other, &at_once).has_value(), moves);
  }
  EXPECT_EQ(in_slices.seconds(), at_once.seconds());
  for (const auto& [id, keyframe] : map.keyframes()) {
    EXPECT_TRUE(same(keyframe.T_w_c, other.keyframes().at(id).T_w_c)) << id;
  }
}

TEST_F(RollingShutterEstimatorTest, WhatIsNotBelievedChangesNothing) {
  const auto expectRefused = [this](double speed, const RollingShutterOptions& options) {
    Map map = mapSeen(speed);
    const Map before = map;
    RollingShutterEstimator estimator = this->estimator(options);
    (void)workUntilDone(map, kUnlimited, &estimator);
    EXPECT_FALSE(collect(&map, &estimator));
    EXPECT_EQ(estimator.seconds(), options.learned_s);
    EXPECT_TRUE(estimator.idle(map)) << "until the map has grown";
    EXPECT_EQ(map.epoch(), before.epoch());
    EXPECT_EQ(map.keyframes().at(3).detections.front().normalized[0],
              before.keyframes().at(3).detections.front().normalized[0]);
  };
  {
    SCOPED_TRACE("a camera at rest");
    expectRefused(0.0, {});
  }
  {
    SCOPED_TRACE("shorter than is believed");
    expectRefused(0.6, {.readout_s = {}, .min_s = 0.05});
  }
  {
    SCOPED_TRACE("longer than is believed");
    expectRefused(0.6, {.readout_s = {}, .max_s = 0.01});
  }
}

TEST_F(RollingShutterEstimatorTest, IsDueAgainWhenTheMapHasGrown) {
  Map map = mapSeen(0.0, 7);
  RollingShutterEstimator estimator =
      this->estimator({.readout_s = {}, .first_keyframes = 8, .growth = 1.5});
  EXPECT_TRUE(estimator.idle(map)) << "too few";
  estimator.work(kUnlimited, camera_, map, bundle_);
  EXPECT_FALSE(estimator.isDone());
  addKeyframe(0.0, &map);
  EXPECT_FALSE(estimator.idle(map));
  (void)workUntilDone(map, kUnlimited, &estimator);
  (void)collect(&map, &estimator);
  while (map.keyframes().size() < 12) {
    addKeyframe(0.0, &map);
    EXPECT_TRUE(estimator.idle(map)) << map.keyframes().size();
  }
  addKeyframe(0.0, &map);
  EXPECT_FALSE(estimator.idle(map)) << "8 * 1.5 are exceeded";
}

TEST_F(RollingShutterEstimatorTest, AGivenReadoutIsNotLearned) {
  Map map = mapSeen(0.6);
  RollingShutterEstimator given = estimator({.readout_s = 0.01, .learned_s = 0.03});
  EXPECT_EQ(given.seconds(), 0.01);
  EXPECT_TRUE(given.idle(map));
  given.work(kUnlimited, camera_, map, bundle_);
  EXPECT_FALSE(given.isDone());
  EXPECT_FALSE(collect(&map, &given));
  EXPECT_EQ(estimator({.readout_s = {}, .learned_s = 0.03}).seconds(), 0.03)
      << "a start, to be improved";
  EXPECT_FALSE(estimator({.readout_s = {}, .learned_s = 0.03}).idle(map));
}

// What the whole map's optimization found is of a world that is no more: it is done again.
TEST_F(RollingShutterEstimatorTest, ACorrectionOfAnotherEpochIsFoundAnew) {
  Map map = mapSeen(0.6);
  RollingShutterEstimator estimator = this->estimator();
  (void)workUntilDone(map, kUnlimited, &estimator);
  EXPECT_FALSE(collect(&map, &estimator));
  estimator.work(20.0, camera_, map, bundle_);
  ASSERT_FALSE(estimator.isDone());
  map.moveWorld({expSo3({0.0, 0.0, 1.0}), {1.0, 2.0, 3.0}});
  const Map moved = map;
  (void)workUntilDone(map, kUnlimited, &estimator);
  EXPECT_FALSE(collect(&map, &estimator));
  EXPECT_EQ(estimator.seconds(), 0.0) << "what is in use and the map go together";
  EXPECT_FALSE(estimator.idle(map));
  for (const auto& [id, keyframe] : map.keyframes()) {
    EXPECT_TRUE(same(keyframe.T_w_c, moved.keyframes().at(id).T_w_c)) << id;
  }
  (void)workUntilDone(map, kUnlimited, &estimator);
  EXPECT_TRUE(collect(&map, &estimator));
  EXPECT_NEAR(estimator.seconds(), kReadout_s, 0.001);
  EXPECT_TRUE(estimator.idle(map));
}

TEST_F(RollingShutterEstimatorTest, DeskewsWithWhatIsInUse) {
  const Map map = mapSeen(0.0, 1);
  const Transform T_w_c = testing::lookAt({0.2, 0.3, -0.1}, {0.0, 3.0, 0.0});
  Twist twist;
  twist << 0.2, 0.1, -0.1, 0.3, 0.8, -0.2;
  int compared = 0;
  for (const auto& marker : markers_) {
    const auto truth = testing::observe(camera_, T_w_c, marker.id, marker.T_w_m, kSize, 0.0, &rng_);
    const auto seen =
        testing::observeRolling(camera_, T_w_c, twist, marker, kSize, kReadout_s, 0.0, &rng_);
    if (!truth || !seen) continue;
    std::vector<MarkerDetection> detections = {*seen};
    estimator().deskew(camera_, map, T_w_c, twist, &detections);
    EXPECT_EQ(detections[0].normalized[2], seen->normalized[2]) << "a global shutter";
    estimator({.readout_s = kReadout_s}).deskew(camera_, map, T_w_c, twist, &detections);
    const double left = (detections[0].normalized[2] - truth->normalized[2]).norm();
    EXPECT_LT(camera_.focalLength() * left, 0.1) << marker.id;
    EXPECT_GT((seen->normalized[2] - truth->normalized[2]).norm(), 2.0 * left) << marker.id;
    ++compared;
  }
  EXPECT_GT(compared, 8);
}

// That a shutter is a global one is news for a map whose corners were doubted until then.
TEST_F(RollingShutterEstimatorTest, TheFirstEstimateEndsTheDoubtInTheMap) {
  Map map = mapSeen(0.6, RollingShutterOptions{}.first_keyframes - 1, 0.0);
  RollingShutterEstimator estimator = this->estimator();
  Map sure = map;
  for (const auto& [id, keyframe] : sure.keyframes()) estimator.deskew(camera_, id, &map);
  const auto firstOf = [](const Map& of) { return of.keyframes().at(3).detections.front(); };
  EXPECT_GT(firstOf(map).covariance[0].norm(), 2.0 * firstOf(sure).covariance[0].norm());
  addKeyframe(0.6, &map, 0.0);
  (void)workUntilDone(map, kUnlimited, &estimator);
  EXPECT_FALSE(collect(&map, &estimator));
  EXPECT_FALSE(estimator.idle(map)) << "the whole map is under way";
  EXPECT_TRUE(firstOf(map).isDoubted()) << "as long as it has not followed";
  (void)workUntilDone(map, kUnlimited, &estimator);
  EXPECT_TRUE(collect(&map, &estimator));
  EXPECT_EQ(estimator.seconds(), 0.0);
  EXPECT_LT(estimator.sigma_s(), 0.001);
  EXPECT_TRUE(estimator.idle(map));
  EXPECT_FALSE(firstOf(map).isDoubted());
  const Eigen::Matrix2d before = firstOf(sure).covariance[0];
  EXPECT_LT((firstOf(map).covariance[0] - before).norm(), 1e-4 * before.norm());

  std::vector<MarkerDetection> seen = map.keyframes().at(3).detections.get();
  estimator.deskew(camera_, map, map.keyframes().at(3).T_w_c, map.keyframes().at(3).twist, &seen);
  EXPECT_FALSE(seen.front().isDoubted()) << "nor are later frames";
}

// Who localizes in a large map, and learns nothing, does not doubt for ever.
TEST_F(RollingShutterEstimatorTest, NothingIsDoubtedInAMapThatIsLargeEnough) {
  const Map map = mapSeen(0.6);
  std::vector<MarkerDetection> seen = map.keyframes().at(3).detections.get();
  estimator().deskew(camera_, map, map.keyframes().at(3).T_w_c, map.keyframes().at(3).twist, &seen);
  EXPECT_FALSE(seen.front().isDoubted());
}

}  // namespace
}  // namespace waymark::slam
