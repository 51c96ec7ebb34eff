#include "slam/final_trajectory.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/slam.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

// A map of two markers on a wall, and a camera that comes nearer to the first from the side. Alone
// and from far it is some 15 pixels wide.
class FinalTrajectoryTest : public ::testing::Test {
 protected:
  static constexpr double kSide_m = 0.12;
  static constexpr int kCount = 90;

  FinalTrajectoryTest() {
    options_.markers.size_m = kSide_m;
    options_.mapping = false;
    for (const testing::SyntheticMarker& marker : markers_) {
      map_.addMarker(marker.id, kSide_m);
      map_.place(marker.id, marker.T_w_m);
    }
  }

  [[nodiscard]] static Transform eyeAt(int i) {
    const double distance_m = 4.0 - 0.01 * i;
    const double tilt_rad = 0.4 + 0.001 * i;
    return testing::lookAt({distance_m * std::sin(tilt_rad), -distance_m * std::cos(tilt_rad), 0.1},
                           Eigen::Vector3d::Zero());
  }
  // Both markers in the frames from `from` up to `to`, else the first alone.
  std::vector<LiveFrame> approach(int from, int to, Slam* slam, double sigma_px = 0.1) {
    std::vector<LiveFrame> frames;
    for (int i = 0; i < kCount; ++i) {
      auto seen = testing::observeAll(camera_, eyeAt(i), markers_, kSide_m, sigma_px, &rng_);
      if (i < from || i >= to) std::erase_if(seen, [](const auto& d) { return d.id == 2; });
      const FrameTime time{static_cast<std::uint64_t>(i), i * 33'333'333LL};
      auto result = slam->process({.time = time, .detections = seen});
      frames.push_back({time.monotonic_ns, std::move(result.pose), std::move(seen)});
    }
    return frames;
  }
  // A pose that features carried live, off by `drift_m`, and more uncertain with the frames since
  // then.
  [[nodiscard]] static PoseEstimate carriedPose(int i, int frames_since, double drift_m) {
    const double frame_s = 1.0 / 30.0;
    PoseEstimate pose;
    const Transform step = eyeAt(i).inverse() * eyeAt(i + 1);
    pose.twist << step.p / frame_s, logSo3(step.R) / frame_s;
    pose.T_w_c = eyeAt(i);
    pose.T_w_c.p.x() += drift_m;
    pose.covariance = pose.view_covariance = 1e-4 * frames_since * Matrix6d::Identity();
    pose.source = PoseSource::kNaturalFeatures;
    pose.features_used = 20;
    return pose;
  }
  [[nodiscard]] Slam makeSlam() const {
    return Slam(camera_, *Dictionary::byName("4X4_50"), options_, map_);
  }
  [[nodiscard]] static bool isNear(const Transform& T_w_c, int i) {
    return rotationDistance(T_w_c.R, eyeAt(i).R) < 0.2;
  }

  std::mt19937 rng_{23};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = {
      {1, testing::markerFacing(Eigen::Vector3d::Zero(), {0.0, -1.0, 0.0})},
      {2, testing::markerFacing({0.6, 0.0, 0.0}, {0.6, -1.0, 0.2})}};
  Options options_;
  Map map_;
};

// The live pose had to wait until the second marker came; at the end it decides for the frames
// before.
TEST_F(FinalTrajectoryTest, FramesBeforeAreDecidedByThoseAfter) {
  Slam slam = makeSlam();
  const auto frames = approach(20, 40, &slam);
  const auto live = std::ranges::count_if(frames, [](const LiveFrame& frame) {
    return frame.pose && frame.pose->ambiguity_ratio >= 3.0;
  });
  const auto all = localizeAll(frames, {}, slam);
  ASSERT_EQ(all.size(), frames.size());
  int decided = 0;
  for (int i = 0; i < kCount; ++i) {
    const auto& pose = all[static_cast<std::size_t>(i)].pose;
    if (!pose || pose->ambiguity_ratio < 3.0) continue;
    ++decided;
    EXPECT_TRUE(isNear(pose->T_w_c, i)) << i;
  }
  EXPECT_GT(decided, live);
  EXPECT_GT(decided, 80);
}

// Frames with several markers have the very pose they have alone.
TEST_F(FinalTrajectoryTest, FramesOfSeveralMarkersAreLeftAlone) {
  Slam slam = makeSlam();
  const auto frames = approach(10, 80, &slam);
  const auto all = localizeAll(frames, {}, slam);
  for (std::size_t i = 10; i < 80; ++i) {
    ASSERT_TRUE(all[i].pose && frames[i].pose) << i;
    const auto alone = slam.localize({i, frames[i].monotonic_ns, frames[i].detections,
                                      frames[i].pose->T_w_c, motionOf(frames, i)});
    ASSERT_TRUE(alone);
    EXPECT_EQ(all[i].pose->T_w_c.p, alone->T_w_c.p);
    EXPECT_EQ(all[i].pose->T_w_c.R, alone->T_w_c.R);
    EXPECT_EQ(all[i].pose->covariance, alone->covariance);
  }
}

// Frame by frame, images in no order.
TEST_F(FinalTrajectoryTest, InNoOrderNeighboursSayNothing) {
  Slam slam = makeSlam();
  const auto frames = approach(20, 40, &slam);
  const auto all = localizeAll(frames, {.unordered_images = true}, slam);
  for (std::size_t i = 50; i < 60; ++i) {
    ASSERT_TRUE(frames[i].pose) << i;
    const auto alone = slam.localize({i, frames[i].monotonic_ns, frames[i].detections,
                                      frames[i].pose->T_w_c, frames[i].pose->twist});
    ASSERT_EQ(all[i].pose.has_value(), alone.has_value());
    if (alone) {
      EXPECT_EQ(all[i].pose->ambiguity_ratio, alone->ambiguity_ratio);
    }
  }
}

TEST_F(FinalTrajectoryTest, WhatIsUndecidedSaysSo) {
  Slam slam = makeSlam();
  auto frames = approach(0, 0, &slam);
  // The last second alone, as if it had been posed: too little for a decision.
  frames.resize(5);
  for (int i = 0; i < 5; ++i) {
    frames[static_cast<std::size_t>(i)].pose.emplace();
    frames[static_cast<std::size_t>(i)].pose->T_w_c = eyeAt(i);
  }
  const auto all = localizeAll(frames, {}, slam);
  for (int i = 0; i < 5; ++i) {
    const FinalPose& frame = all[static_cast<std::size_t>(i)];
    if (!frame.pose) {
      EXPECT_EQ(frame.reason, NoPoseReason::kAmbiguousMarker);
      continue;
    }
    EXPECT_LT(frame.pose->ambiguity_ratio, 3.0);
    const Vector6d error = frame.pose->T_w_c.localCoordinates(eyeAt(i));
    EXPECT_LT(error.dot(frame.pose->covariance.ldlt().solve(error)), 30.0);
  }
}

// A gap whose live poses drifted by 3 cm until the next marker was seen.
TEST_F(FinalTrajectoryTest, BetweenMarkersBothEndsCorrectWhatWasCarried) {
  constexpr int kBegin = 30;
  constexpr int kEnd = 60;
  constexpr double kDrift_m = 0.001;  // a frame
  const auto carry = [&](int i, LiveFrame* frame) {
    const int since = i - kBegin + 1;
    frame->pose = carriedPose(i, since, kDrift_m * since);
    frame->detections.clear();
  };
  Slam slam = makeSlam();
  auto frames = approach(0, kCount, &slam, 0.002);
  for (int i = kBegin; i < kEnd; ++i) carry(i, &frames[static_cast<std::size_t>(i)]);
  const auto all = localizeAll(frames, {}, slam);
  for (int i = kBegin; i < kEnd; ++i) {
    const auto& pose = all[static_cast<std::size_t>(i)].pose;
    ASSERT_TRUE(pose) << i;
    EXPECT_EQ(pose->source, PoseSource::kNaturalFeatures);
    EXPECT_LT((pose->T_w_c.p - eyeAt(i).p).norm(), 0.008) << i;
  }
  const auto& last = *all[kEnd - 1].pose;
  EXPECT_LT(last.covariance.trace(), frames[kEnd - 1].pose->covariance.trace());

  // Nothing comes after it: what was told live stands.
  frames.resize(kEnd);
  const auto open = localizeAll(frames, {}, slam);
  ASSERT_TRUE(open[kEnd - 1].pose);
  EXPECT_NEAR((open[kEnd - 1].pose->T_w_c.p - eyeAt(kEnd - 1).p).norm(), 0.03, 0.008);
}

// Near where a map began, a pose is known better in the world than relative to what is in view.
TEST_F(FinalTrajectoryTest, WhatIsKnownBetterInTheWorldLeavesACovariance) {
  constexpr int kBegin = 30;
  constexpr int kEnd = 60;
  Slam slam = makeSlam();
  auto frames = approach(0, kCount, &slam, 0.002);
  for (int i = kBegin; i < kEnd; ++i) {
    LiveFrame& frame = frames[static_cast<std::size_t>(i)];
    frame.pose = carriedPose(i, i - kBegin + 1, 0.0);
    frame.pose->covariance *= 0.2;
    frame.pose->covariance(0, 0) *= 10.0;
    frame.detections.clear();
  }
  const auto all = localizeAll(frames, {}, slam);
  for (int i = kBegin; i < kEnd; ++i) {
    const auto& pose = all[static_cast<std::size_t>(i)].pose;
    ASSERT_TRUE(pose) << i;
    const Matrix6d beyond = pose->covariance - pose->view_covariance;
    EXPECT_EQ(pose->covariance.llt().info(), Eigen::Success) << i;
    EXPECT_NEAR(beyond(0, 0), 1e-4 * (i - kBegin + 1), 1e-9) << "what the world adds stays";
    EXPECT_NEAR(beyond(1, 1), 0.0, 1e-9) << i;
  }
}

// The marker is still in view, but so badly that the features knew better.
TEST_F(FinalTrajectoryTest, MarkersThatSayLessThanTheFeaturesDidAreLeftToThese) {
  constexpr int kBegin = 30;
  constexpr int kEnd = 60;
  Slam slam = makeSlam();
  auto frames = approach(0, kCount, &slam, 0.002);
  std::mt19937 rng(4);
  std::normal_distribution<double> noise(0.0, 2.0 / 520.0);
  for (int i = kBegin; i < kEnd; ++i) {
    LiveFrame& frame = frames[static_cast<std::size_t>(i)];
    frame.pose = carriedPose(i, 1, 0.001);
    frame.pose->source = PoseSource::kMarkers;
    frame.pose->view_covariance = 1e-6 * Matrix6d::Identity();
    for (MarkerDetection& detection : frame.detections) {
      for (std::size_t k = 0; k < 4; ++k) {
        detection.normalized[k] += Eigen::Vector2d(noise(rng), noise(rng));
        detection.covariance[k] *= 1e6;
      }
    }
  }
  const auto all = localizeAll(frames, {}, slam);
  for (int i = kBegin; i < kEnd; ++i) {
    const auto& pose = all[static_cast<std::size_t>(i)].pose;
    ASSERT_TRUE(pose) << i;
    EXPECT_EQ(pose->features_used, 20) << i;
    EXPECT_LT((pose->T_w_c.p - eyeAt(i).p).norm(), 0.008) << i;
  }
}

// But not those of two that are exact, whatever is told of the features: they may have been
// followed through a lens that was not known yet.
TEST_F(FinalTrajectoryTest, TwoMarkersAreNotOverruledByFeaturesThatContradictThem) {
  constexpr int kBegin = 30;
  constexpr int kEnd = 60;
  Slam slam = makeSlam();
  auto frames = approach(0, kCount, &slam, 0.002);
  for (int i = kBegin; i < kEnd; ++i) {
    LiveFrame& frame = frames[static_cast<std::size_t>(i)];
    const double from_end = std::min(i - kBegin, kEnd - 1 - i);
    frame.pose = carriedPose(i, 1, 0.005 * from_end);
    frame.pose->source = PoseSource::kMarkers;
    frame.pose->covariance = frame.pose->view_covariance = 1e-8 * Matrix6d::Identity();
    for (MarkerDetection& detection : frame.detections) {
      for (auto& covariance : detection.covariance) covariance *= 1e4;
    }
  }
  const auto all = localizeAll(frames, {}, slam);
  for (int i = kBegin; i < kEnd; ++i) {
    const auto& pose = all[static_cast<std::size_t>(i)].pose;
    ASSERT_TRUE(pose) << i;
    EXPECT_LT((pose->T_w_c.p - eyeAt(i).p).norm(), 0.045) << i << ", 0.064 by the features";
  }
}

// Live motions are of live poses, and move a rolling shutter's corners: where those were wrong the
// final ones tell.
TEST_F(FinalTrajectoryTest, HowTheCameraMovedIsAskedOfTheFinalPoses) {
  options_.shutter.readout_s = 0.02;
  const Transform T_w_c = testing::lookAt({1.4, -3.2, 0.1}, {0.0, 0.0, -0.8});  // they are high up
  const Slam slam = makeSlam();
  std::vector<LiveFrame> frames;
  for (int i = 0; i < 40; ++i) {
    PoseEstimate pose;
    pose.T_w_c = T_w_c;
    if (i >= 10 && i < 30) pose.twist[0] = 1.0;
    frames.push_back({i * 33'333'333LL, pose,
                      testing::observeAll(camera_, T_w_c, markers_, kSide_m, 0.002, &rng_)});
  }
  const auto all = localizeAll(frames, {}, slam);
  for (std::size_t i = 0; i < all.size(); ++i) {
    ASSERT_TRUE(all[i].pose) << i;
    EXPECT_LT((all[i].pose->T_w_c.p - T_w_c.p).norm(), 0.004) << i << ", 0.059 with live motions";
  }
}

// Pictures alone: no frame's markers are in the map.
TEST_F(FinalTrajectoryTest, WithoutAnyMarkerPosesAreAsTheyWereLive) {
  Slam slam = makeSlam();
  auto frames = approach(0, kCount, &slam, 0.002);
  for (int i = 0; i < kCount; ++i) {
    LiveFrame& frame = frames[static_cast<std::size_t>(i)];
    frame.detections.clear();
    frame.pose.reset();
    if (i >= 10) frame.pose = carriedPose(i, i, 0.001);
  }
  const auto all = localizeAll(frames, {}, slam);
  for (int i = 0; i < kCount; ++i) {
    const auto& pose = all[static_cast<std::size_t>(i)].pose;
    ASSERT_EQ(pose.has_value(), i >= 10) << i;
    if (!pose) continue;
    EXPECT_EQ(pose->T_w_c.p, frames[static_cast<std::size_t>(i)].pose->T_w_c.p);
  }
}

TEST_F(FinalTrajectoryTest, FramesWithoutAPoseSayWhy) {
  Slam slam = makeSlam();
  auto frames = approach(0, kCount, &slam);
  frames[30].detections.clear();
  for (MarkerDetection& seen : frames[31].detections) seen.id += 10;
  const auto all = localizeAll(frames, {}, slam);
  EXPECT_EQ(all[29].reason, NoPoseReason::kNone);
  EXPECT_EQ(all[30].reason, NoPoseReason::kNoMarker);
  EXPECT_EQ(all[31].reason, NoPoseReason::kNoKnownMarker);
  EXPECT_TRUE(localizeAll({}, {}, slam).empty());
}

}  // namespace
}  // namespace waymark::slam
