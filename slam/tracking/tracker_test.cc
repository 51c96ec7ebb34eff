#include "slam/tracking/tracker.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

using testing::kFramePeriodNs;

constexpr double kSize = 0.2;

// A camera that passes two or more large markers at 1.5 m, a centimetre a frame.
class TrackerTest : public ::testing::Test {
 protected:
  static Transform poseAt(int frame) {
    return testing::lookAt({0.01 * frame, 1.5, 0.2}, {0.01 * frame, 3.0, 0.0});
  }

  // What the camera sees of some of the markers, as the map knows them.
  std::vector<KnownMarker> known(int frame, const std::vector<int>& ids, double sigma_px = 0.02) {
    detections_ = testing::observeAll(camera_, poseAt(frame), markers_, kSize, sigma_px, &rng_);
    std::erase_if(detections_, [&](const MarkerDetection& d) {
      return std::find(ids.begin(), ids.end(), d.id) == ids.end();
    });
    EXPECT_EQ(detections_.size(), ids.size());
    return testing::knownFrom(detections_, in_map_, kSize);
  }

  // Tracking has gone well up to this frame.
  void trackUpTo(int frame) {
    for (int i = 0; i < frame; ++i)
      tracker_.commit(poseAt(i), Matrix6d::Zero(), i * kFramePeriodNs);
  }

  void expectPose(const std::optional<TrackedPose>& tracked, int frame, double worst_m) {
    ASSERT_TRUE(tracked);
    EXPECT_LT((tracked->solution.T_w_c.p - poseAt(frame).p).norm(), worst_m);
  }

  std::mt19937 rng_{41};
  CameraModel camera_{testing::testCalibration()};
  // Turned away from the camera by some 40 degrees, one to each side.
  std::vector<testing::SyntheticMarker> markers_ = {
      {0, testing::markerFacing({-0.4, 3.0, 0.1}, {-1.6, 1.5, 0.3})},
      {1, testing::markerFacing({0.4, 3.0, 0.1}, {1.6, 1.5, -0.2})},
      {2, testing::markerFacing({0.0, 3.0, -0.3}, {0.5, 1.5, -1.5})},
  };
  std::vector<testing::SyntheticMarker> in_map_ = markers_;
  std::vector<MarkerDetection> detections_;
  Tracker tracker_{camera_.focalLength(), TrackerOptions{}};
};

TEST_F(TrackerTest, FollowsThePrediction) {
  trackUpTo(5);
  const auto tracked = tracker_.track(known(5, {0, 1, 2}), tracker_.predict(5 * kFramePeriodNs));
  expectPose(tracked, 5, 0.001);
  EXPECT_EQ(tracked->method, TrackingMethod::kPredicted);
  EXPECT_FALSE(tracked->prediction_rejected);
}

TEST_F(TrackerTest, RelocalizesWithoutAPrediction) {
  const auto first = tracker_.track(known(5, {0, 1, 2}), tracker_.predict(0));
  expectPose(first, 5, 0.001);
  EXPECT_EQ(first->method, TrackingMethod::kRelocalized);
  EXPECT_FALSE(first->prediction_rejected);
  trackUpTo(5);
  const auto later = tracker_.track(known(5, {0, 1, 2}), tracker_.predict(2'000'000'000));
  expectPose(later, 5, 0.001);
  EXPECT_EQ(later->method, TrackingMethod::kRelocalized) << "the last pose is too old";
}

TEST_F(TrackerTest, RelocalizesWhenThePredictionIsWrong) {
  tracker_.commit(testing::lookAt({0.0, 1.5, 0.0}, {0.0, -3.0, 0.0}), Matrix6d::Zero(),
                  0);  // looks away
  const auto tracked = tracker_.track(known(1, {0, 1, 2}), tracker_.predict(kFramePeriodNs));
  expectPose(tracked, 1, 0.001);
  EXPECT_EQ(tracked->method, TrackingMethod::kRelocalized);
  EXPECT_TRUE(tracked->prediction_rejected);
}

// Tracking tries; only commit() makes it so.
TEST_F(TrackerTest, TrackChangesNothing) {
  trackUpTo(5);
  const auto markers = known(5, {0, 1, 2});
  const auto once = tracker_.track(markers, tracker_.predict(5 * kFramePeriodNs));
  const auto again = tracker_.track(markers, tracker_.predict(5 * kFramePeriodNs));
  ASSERT_TRUE(once && again);
  EXPECT_EQ(once->solution.T_w_c.p, again->solution.T_w_c.p);
}

// One of two markers hangs 20 cm from where the map has it. The other one's pose goes on as the
// camera moved, and is believed.
TEST_F(TrackerTest, OfTwoThatContradictTheOneThatGoesOnIsBelieved) {
  for (const std::size_t moved : {0U, 1U}) {
    in_map_ = markers_;
    in_map_[moved].T_w_m.p += Eigen::Vector3d(0.1, 0.1, 0.15);
    Tracker tracker(camera_.focalLength(), TrackerOptions{});
    for (int i = 0; i < 5; ++i) tracker.commit(poseAt(i), Matrix6d::Zero(), i * kFramePeriodNs);
    const auto tracked = tracker.track(known(5, {0, 1}), tracker.predict(5 * kFramePeriodNs));
    expectPose(tracked, 5, 0.003);
    EXPECT_EQ(tracked->method, TrackingMethod::kPredicted);
    EXPECT_EQ(tracked->solution.inliers, 1);
    EXPECT_EQ(tracked->solution.inlier[moved], false);
    EXPECT_EQ(tracked->solution.inlier[1 - moved], true);
  }
}

TEST_F(TrackerTest, OfTwoThatContradictNeitherIsBelievedFarFromThePrediction) {
  in_map_[0].T_w_m.p += Eigen::Vector3d(0.1, 0.1, 0.15);
  TrackerOptions options;
  options.max_innovation_per_rms = 0.0;
  Tracker tracker(camera_.focalLength(), options);
  for (int i = 0; i < 5; ++i) tracker.commit(poseAt(i), Matrix6d::Zero(), i * kFramePeriodNs);
  EXPECT_FALSE(tracker.track(known(5, {0, 1}), tracker.predict(5 * kFramePeriodNs)));
}

// Nobody knows which one to believe: neither goes on, or there is nothing to go on from.
TEST_F(TrackerTest, TwoThatContradictGiveNoPoseOtherwise) {
  in_map_[0].T_w_m.p += Eigen::Vector3d(0.1, 0.1, 0.15);
  EXPECT_FALSE(tracker_.track(known(5, {0, 1}), tracker_.predict(0))) << "no prediction";
  in_map_[1].T_w_m.p += Eigen::Vector3d(-0.15, 0.1, 0.1);
  trackUpTo(5);
  EXPECT_FALSE(tracker_.track(known(5, {0, 1}), tracker_.predict(5 * kFramePeriodNs)))
      << "both moved";
}

TEST_F(TrackerTest, OfThreeTheMajorityIsBelieved) {
  in_map_[0].T_w_m.p += Eigen::Vector3d(0.1, 0.1, 0.15);
  trackUpTo(5);
  const auto tracked = tracker_.track(known(5, {0, 1, 2}), tracker_.predict(5 * kFramePeriodNs));
  expectPose(tracked, 5, 0.002);
  EXPECT_FALSE(tracked->solution.inlier[0]);
  EXPECT_TRUE(tracked->solution.inlier[1]);
  EXPECT_TRUE(tracked->solution.inlier[2]);
}

TEST_F(TrackerTest, NoMarkersNoPose) {
  EXPECT_FALSE(tracker_.track({}, tracker_.predict(0)));
  trackUpTo(5);
  EXPECT_FALSE(tracker_.track({}, tracker_.predict(5 * kFramePeriodNs)));
}

// One small frontal marker is a coin toss; beside others in another plane it is not.
TEST_F(TrackerTest, AmbiguityTellsACoinTossFromCertainty) {
  const auto ambiguityOf = [&](const std::vector<KnownMarker>& markers,
                               const TrackerOptions& options = {}) {
    PoseSolution solution;
    solution.T_w_c = poseAt(0);
    solution.inlier.assign(markers.size(), true);
    for (const auto& m : markers) {
      solution.chi2 += PoseOptimizer::markerChi2(m, poseAt(0)).value();
    }
    return poseAmbiguity(solution, markers, camera_.focalLength(), options);
  };
  in_map_ = markers_ = {{0, testing::markerFacing({0.0, 8.0, 0.2}, {0.0, 1.5, 0.2})}};
  EXPECT_LT(ambiguityOf(known(0, {0}, 0.3)), 3.0);
  in_map_ = markers_ = {{0, testing::markerFacing({-0.4, 3.0, 0.1}, {-1.6, 1.5, 0.3})},
                        {1, testing::markerFacing({0.4, 3.0, 0.1}, {1.6, 1.5, -0.2})}};
  EXPECT_GT(ambiguityOf(known(0, {0, 1})), 100.0);
  TrackerOptions options;
  options.ambiguity_floor = 1e12;
  EXPECT_LT(ambiguityOf(known(0, {0, 1}), options), 1.1);
}

}  // namespace
}  // namespace waymark::slam
