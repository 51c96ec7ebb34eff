// The whole loop on exact corners: no images, so it runs in milliseconds.
#include "slam/slam.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.12;
constexpr std::int64_t kFramePeriodNs = 16'666'667;

class SlamTest : public ::testing::Test {
 protected:
  static Options options() {
    Options o;
    o.markers.size_m = kSize;
    return o;
  }

  // A walk along the wall, frame by frame.
  [[nodiscard]] Transform poseAt(int frame) const {
    const double s = 0.01 * frame;
    return testing::lookAt({-1.0 + s, 0.3 * std::sin(s), 0.2 * std::cos(2.0 * s)},
                           {-0.6 + 0.8 * s, 3.0, 0.1 * std::sin(3.0 * s)});
  }

  FrameResult feed(int frame) {
    detections_ = testing::observeAll(camera_, poseAt(frame), markers_, kSize, 0.05, &rng_);
    return slam_.processDetections(detections_,
                                   {static_cast<std::uint64_t>(frame), frame * kFramePeriodNs});
  }

  std::mt19937 rng_{9};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(3, 8, 0.4, &rng_);
  std::vector<MarkerDetection> detections_;
  Slam slam_{camera_, *Dictionary::byName("APRILTAG_36h11"), options()};
};

TEST_F(SlamTest, TracksAndMapsAWall) {
  ASSERT_TRUE(feed(0).pose);
  const Transform T_truth_w = poseAt(0);  // the first keyframe is the world
  for (int i = 1; i < 150; ++i) {
    const FrameResult result = feed(i);
    ASSERT_TRUE(result.pose) << "frame " << i << ": " << result.reason;
    EXPECT_EQ(result.state, TrackingState::kTracking);
    const Transform expected = T_truth_w.inverse() * poseAt(i);
    EXPECT_LT((result.pose->T_w_c.p - expected.p).norm(), 0.03) << "frame " << i;
  }
  slam_.optimiseGlobally();
  std::size_t posed = 0;
  for (const auto& [id, marker] : slam_.map().markers()) {
    if (!marker.T_w_m) continue;
    ++posed;
    const Transform expected = T_truth_w.inverse() * markers_[static_cast<std::size_t>(id)].T_w_m;
    EXPECT_LT((marker.T_w_m->p - expected.p).norm(), 0.03) << "marker " << id;
  }
  EXPECT_GE(posed, 20U);
  EXPECT_EQ(slam_.counters().frames, 150U);
  EXPECT_EQ(slam_.counters().localized, 150U);
}

TEST_F(SlamTest, SaysWhyItHasNotStarted) {
  const FrameResult nothing = slam_.processDetections({}, {0, 0});
  EXPECT_FALSE(nothing.pose);
  EXPECT_EQ(nothing.state, TrackingState::kInitializing);
  EXPECT_STREQ(nothing.reason, "no marker in view");
}

TEST_F(SlamTest, RelocalisesAfterABlackout) {
  for (int i = 0; i < 60; ++i) (void)feed(i);
  for (int i = 60; i < 160; ++i) {
    const FrameResult dark =
        slam_.processDetections({}, {static_cast<std::uint64_t>(i), i * kFramePeriodNs});
    EXPECT_FALSE(dark.pose);
    EXPECT_EQ(dark.state, TrackingState::kRelocalizing);
  }
  // The camera comes back where it was at frame 30.
  detections_ = testing::observeAll(camera_, poseAt(30), markers_, kSize, 0.05, &rng_);
  const FrameResult back = slam_.processDetections(detections_, {160, 160 * kFramePeriodNs});
  ASSERT_TRUE(back.pose);
  EXPECT_LT((back.pose->T_w_c.p - (poseAt(0).inverse() * poseAt(30)).p).norm(), 0.02);
  EXPECT_EQ(slam_.counters().relocalizations, 1U);
}

TEST_F(SlamTest, TheSameInputGivesTheSameBytes) {
  Slam other{camera_, *Dictionary::byName("APRILTAG_36h11"), options()};
  for (int i = 0; i < 80; ++i) {
    const FrameResult a = feed(i);
    const FrameResult b =
        other.processDetections(detections_, {static_cast<std::uint64_t>(i), i * kFramePeriodNs});
    ASSERT_EQ(a.pose.has_value(), b.pose.has_value());
    if (!a.pose) continue;
    EXPECT_EQ(a.pose->T_w_c.R, b.pose->T_w_c.R);
    EXPECT_EQ(a.pose->T_w_c.p, b.pose->T_w_c.p);
    EXPECT_EQ(a.pose->covariance, b.pose->covariance);
  }
}

TEST_F(SlamTest, OptionsSayWhatIsWrong) {
  EXPECT_EQ(options().invalidReason(), "");
  Options o = options();
  o.markers.size_m = 0.0;
  EXPECT_NE(o.invalidReason(), "");
  o = options();
  o.detector.scanner.threshold_window_px = 14;
  EXPECT_NE(o.invalidReason(), "");
  o = options();
  o.mapper.keyframes.views_per_marker = 1;
  EXPECT_NE(o.invalidReason(), "");
}

}  // namespace
}  // namespace waymark::slam
