#include "tools/evaluation/accuracy_limit.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::tools {
namespace {

constexpr double kSize_m = 0.12;
constexpr std::int64_t kPeriod_ns = 33'333'333;

// A camera that walks along a wall of 20 markers; its world is the truth's.
struct Recording {
  explicit Recording(double sigma_px, int frame_count = 60) : rng(3) {
    const auto markers = slam::testing::markerWall(4, 5, 0.5, &rng);
    for (const auto& marker : markers) {
      io::MarkerCorners corners{marker.id, kSize_m, slam::markerCorners(kSize_m)};
      for (Eigen::Vector3d& corner : corners.corners) corner = marker.T_w_m * corner;
      layout.push_back(corners);
    }
    for (int i = 0; i < frame_count; ++i) {
      const double s = static_cast<double>(i) / frame_count;
      const slam::Transform T_w_c = slam::testing::lookAt(
          {2.0 * s - 1.0, 0.5 * std::sin(6.0 * s), 0.3 * std::cos(9.0 * s)}, {s - 0.5, 3.0, 0.0});
      truth.push_back({i * kPeriod_ns, T_w_c});
      frames.push_back({i * kPeriod_ns, slam::testing::observeAll(camera, T_w_c, markers, kSize_m,
                                                                  sigma_px, &rng)});
    }
  }

  [[nodiscard]] Result<AccuracyLimit> limit(const LimitOptions& options = {}) const {
    return accuracyLimit(frames, camera, truth, layout, {}, options);
  }

  std::mt19937 rng;
  slam::CameraModel camera{slam::testing::testCalibration()};
  io::Trajectory truth;
  std::vector<io::MarkerCorners> layout;
  std::vector<io::RecordedFrame> frames;
};

TEST(AccuracyLimit, ExactCornersHaveNone) {
  const auto limit = Recording(0.0).limit();
  ASSERT_TRUE(limit.ok()) << limit.error().message;
  EXPECT_EQ(limit->frames, 60U);
  EXPECT_EQ(limit->map.common, 20U);
  EXPECT_EQ(limit->outlier_views, 0U);
  EXPECT_LT(limit->corner_rms_px, 1e-6);
  EXPECT_LT(limit->trajectory.ate_m.mean, 1e-6);
  EXPECT_LT(limit->map.ace_m.mean, 1e-6);
}

// Ten times the noise, ten times the limit; and the noise itself comes out.
TEST(AccuracyLimit, GrowsWithTheNoise) {
  const auto fine = Recording(0.02).limit();
  const auto coarse = Recording(0.2).limit();
  ASSERT_TRUE(fine.ok() && coarse.ok());
  EXPECT_NEAR(fine->corner_rms_px, 0.02, 0.001);
  EXPECT_NEAR(coarse->corner_rms_px, 0.2, 0.01);
  EXPECT_NEAR(coarse->trajectory.ate_m.mean / fine->trajectory.ate_m.mean, 10.0, 1.0);
  EXPECT_NEAR(coarse->map.ace_m.mean / fine->map.ace_m.mean, 10.0, 1.0);
  EXPECT_GT(fine->map.ace_m.mean, 1e-6);
}

TEST(AccuracyLimit, MoreFramesKnowMore) {
  const Recording recording(0.2, 200);
  LimitOptions few;
  few.frames = 10;
  const auto with_few = recording.limit(few);
  const auto with_all = recording.limit();
  ASSERT_TRUE(with_few.ok() && with_all.ok());
  EXPECT_EQ(with_few->frames, 10U);
  EXPECT_EQ(with_all->frames, 180U);
  EXPECT_LT(with_all->map.ace_m.mean, 0.5 * with_few->map.ace_m.mean);
}

// A marker that has left its place and a false id count as gross and spoil nothing.
TEST(AccuracyLimit, GrossCornersAreLeftOut) {
  Recording recording(0.05);
  const auto undisturbed = recording.limit();
  std::size_t gross = 0;
  for (std::size_t f = 30; f < recording.frames.size(); ++f) {
    for (slam::MarkerDetection& detection : recording.frames[f].detections) {
      if (detection.id != 7 && detection.id != 12) continue;
      ++gross;
      for (std::size_t k = 0; k < 4; ++k) {
        detection.pixels[k].x() += 12.0;
        detection.normalized[k] = *recording.camera.undistort(detection.pixels[k]);
      }
    }
  }
  recording.frames[3].detections.front().id = 999;  // not in the truth: not even gross
  const auto limit = recording.limit();
  ASSERT_TRUE(undisturbed.ok() && limit.ok());
  EXPECT_GT(gross, 30U);
  EXPECT_EQ(limit->outlier_views, gross);
  EXPECT_EQ(limit->map.common, 20U);
  EXPECT_LT(limit->map.ace_m.mean, 1.3 * undisturbed->map.ace_m.mean);
}

TEST(AccuracyLimit, NothingToAdjustIsAnError) {
  Recording recording(0.1, 5);
  EXPECT_FALSE(accuracyLimit({}, recording.camera, recording.truth, recording.layout, {}, {}).ok());
  EXPECT_FALSE(
      accuracyLimit(recording.frames, recording.camera, {}, recording.layout, {}, {}).ok());
  EXPECT_FALSE(accuracyLimit(recording.frames, recording.camera, recording.truth, {}, {}, {}).ok());
  for (io::RecordedFrame& frame : recording.frames) frame.detections.clear();
  EXPECT_FALSE(recording.limit().ok());
}

}  // namespace
}  // namespace waymark::tools
