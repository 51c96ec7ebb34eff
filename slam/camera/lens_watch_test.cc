#include "slam/camera/lens_watch.h"

#include <cmath>
#include <numbers>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "slam/camera_pose/pose_optimizer.h"
#include "slam/testing/lens_scene.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.15;
constexpr double kSigma_px = 0.05;
constexpr double kDegree = std::numbers::pi / 180.0;
const BundleOptions kBundle{.max_iterations = 20, .min_relative_decrease = 1e-8};

CameraModel scaled(const CameraModel& camera, double focal, double k1) {
  IntrinsicVector v = camera.intrinsics();
  v.head<2>() *= focal;
  v[4] += k1;
  return CameraModel(camera.withIntrinsics(v));
}

// A camera that walks to and fro along a known wall of markers, 30 frames a second.
class LensWatchTest : public ::testing::Test {
 protected:
  // One more frame, taken through `lens`, and told as the lens in use has it.
  void frame(const CameraModel& lens, LensWatch* watch) {
    const double way = 0.8 * std::sin(0.05 * frames_);
    const Transform T_w_c = testing::lookAt({way, 1.2 + 0.3 * std::cos(0.03 * frames_), 0.2},
                                            {0.4 * way, 3.0, 0.1 * std::sin(0.04 * frames_)});
    auto seen = testing::observeAll(lens, T_w_c, markers_, kSize, kSigma_px, &rng_);
    for (MarkerDetection& detection : seen) ASSERT_TRUE(undistortCorners(camera_, &detection));
    const auto known = testing::knownFrom(seen, map_, kSize);
    const auto solution = PoseOptimizer(camera_.focalLength()).optimize(known, T_w_c);
    ASSERT_TRUE(solution);
    time_.monotonic_ns += kFrame_ns;
    ++frames_;
    watch->look(time_, solution->T_w_c, Twist::Zero(), known);
    watch->work(1000.0, *shutter_, kBundle);
  }
  // Frames until another lens is in use; so many at most.
  int framesUntilLearned(const CameraModel& lens, int at_most, LensWatch* watch) {
    for (int i = 1; i <= at_most; ++i) {
      frame(lens, watch);
      if (watch->collect(*shutter_)) return i;
    }
    return -1;
  }
  [[nodiscard]] double focalError(const CameraModel& truth) const {
    return camera_.calibration().fx / truth.calibration().fx - 1.0;
  }

  static constexpr std::int64_t kFrame_ns = 33'333'333;
  std::mt19937 rng_{4};
  CameraModel truth_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(3, 6, 0.4, &rng_);
  std::vector<testing::SyntheticMarker> map_ = markers_;  // where they are thought to be
  MarkerOptions options_{.size_m = kSize};
  std::optional<RollingShutterEstimator> shutter_{
      std::in_place, RollingShutterOptions{.readout_s = 0.0}, options_};
  CameraModel camera_ = truth_;
  LensKnowledge knowledge_{.given = truth_};
  FrameTime time_{0, 1'000'000'000};
  int frames_ = 0;
};

TEST_F(LensWatchTest, LearnsAWrongLensInAKnownMap) {
  camera_ = scaled(truth_, 0.97, -0.04);
  knowledge_ = {.given = camera_};
  LensWatch watch({}, options_, /*map_grows=*/false, &camera_, &knowledge_);
  EXPECT_GT(framesUntilLearned(truth_, 200, &watch), 0);
  EXPECT_LT(std::abs(focalError(truth_)), 2e-3);
  EXPECT_EQ(knowledge_.changes, 1);
  EXPECT_FALSE(knowledge_.changedUnderWay()) << "it was never another one";
}

// A tenth of a per cent of focal length does not make the corners fit better by a fifth, and a few
// markers might be wrong by themselves.
TEST_F(LensWatchTest, WhatFewViewsLeaveOpenMoreDecide) {
  camera_ = scaled(truth_, 1.001, 0.0);
  knowledge_ = {.given = camera_};
  LensWatch watch({}, options_, /*map_grows=*/false, &camera_, &knowledge_);
  const int frames = framesUntilLearned(truth_, 600, &watch);
  EXPECT_GT(frames, 2 * LensWatchOptions{}.max_frames) << "every other one is another view";
  EXPECT_GT(knowledge_.rms_after_px, LensOptions{}.material_rms * knowledge_.rms_before_px);
  EXPECT_LT(std::abs(focalError(truth_)), 3.0 * knowledge_.focalShare());
}

// What was learned from corners that a rolling shutter had moved, as the wrong lens has the camera
// move, is half way to where the lens is.
TEST_F(LensWatchTest, WhatWasLearnedThroughARollingShutterIsMeasuredAnew) {
  const CameraModel half_way = scaled(truth_, 1.003, 0.0);
  camera_ = scaled(truth_, 1.02, 0.0);
  knowledge_ = {.given = camera_};
  shutter_.emplace(RollingShutterOptions{.readout_s = 0.02}, options_);
  LensWatch watch({}, options_, /*map_grows=*/false, &camera_, &knowledge_);
  ASSERT_GT(framesUntilLearned(half_way, 200, &watch), 0);
  EXPECT_LT(std::abs(focalError(half_way)), 2e-3);
  for (int i = 0; i < 300; ++i) (void)framesUntilLearned(truth_, 1, &watch);
  EXPECT_GE(knowledge_.changes, 2);
  EXPECT_LE(knowledge_.changes, 5) << "and comes to an end";
  EXPECT_LT(std::abs(focalError(truth_)), 4.0 * knowledge_.focalShare());
}

TEST_F(LensWatchTest, ARightLensStays) {
  LensWatch in_known_map({}, options_, /*map_grows=*/false, &camera_, &knowledge_);
  EXPECT_EQ(framesUntilLearned(truth_, 300, &in_known_map), -1);
  LensWatch in_growing_map({}, options_, /*map_grows=*/true, &camera_, &knowledge_);
  EXPECT_EQ(framesUntilLearned(truth_, 300, &in_growing_map), -1);
  EXPECT_EQ(knowledge_.state, LensState::kGiven);
}

// Nobody has measured it, and what it was taken for at first is of the wrong model.
TEST_F(LensWatchTest, LearnsAWideLensInAKnownMap) {
  const CameraModel wide = testing::wideLens();
  camera_ = testing::wideLensAtFirst(&knowledge_);
  LensOptions options;
  options.takeForGuess(/*fov_said=*/false);
  LensWatch watch(options, options_, /*map_grows=*/false, &camera_, &knowledge_);
  EXPECT_GT(framesUntilLearned(wide, 30, &watch), 0);
  EXPECT_EQ(camera_.calibration().model, DistortionModel::kEquidistant);
  for (int i = 0; i < 200; ++i) {
    frame(wide, &watch);
    (void)watch.collect(*shutter_);
  }
  EXPECT_LT(std::abs(focalError(wide)), 2e-3);
  EXPECT_LT(std::abs(focalError(wide)), 4.0 * knowledge_.focalShare());
}

// An autofocus breathes by 3 %.
TEST_F(LensWatchTest, NoticesALensThatChangesUnderWay) {
  LensWatch watch({}, options_, /*map_grows=*/true, &camera_, &knowledge_);
  EXPECT_EQ(framesUntilLearned(truth_, 150, &watch), -1);
  const std::int64_t changed_ns = time_.monotonic_ns;
  const CameraModel after = scaled(truth_, 1.03, 0.0);
  const int frames = framesUntilLearned(after, 150, &watch);
  EXPECT_GT(frames, 0);
  EXPECT_LT(frames * 1e-9 * kFrame_ns, 5.0);
  EXPECT_LT(std::abs(focalError(after)), 3e-3);
  ASSERT_TRUE(knowledge_.changedUnderWay());
  EXPECT_GE(knowledge_.since_ns, changed_ns);
  EXPECT_LT(knowledge_.since_ns, changed_ns + 1'000'000'000);
  EXPECT_EQ(knowledge_.at(changed_ns, camera_).calibration(), truth_.calibration());
  EXPECT_EQ(knowledge_.at(time_.monotonic_ns, camera_).calibration(), camera_.calibration());
  EXPECT_EQ(framesUntilLearned(after, 150, &watch), -1) << "and that is that";
}

// What looks like one in a map that grows is a bend of the map.
TEST_F(LensWatchTest, AZoomIsNoChangeOfFocusWhileTheMapGrows) {
  const CameraModel zoomed = scaled(truth_, 1.2, 0.0);
  LensWatch in_growing_map({}, options_, /*map_grows=*/true, &camera_, &knowledge_);
  EXPECT_EQ(framesUntilLearned(truth_, 150, &in_growing_map), -1);
  EXPECT_EQ(framesUntilLearned(zoomed, 150, &in_growing_map), -1);
  EXPECT_EQ(camera_.calibration(), truth_.calibration());
  LensWatch in_known_map({}, options_, /*map_grows=*/false, &camera_, &knowledge_);
  EXPECT_GT(framesUntilLearned(zoomed, 200, &in_known_map), 0) << "which cannot bend";
}

// Where the ends of a loop meet, half of the markers are off. The lens that explains that best has
// another distortion, or another focal length.
TEST_F(LensWatchTest, ABendInAMapThatGrowsIsNotTheLens) {
  const auto turn = [](const Eigen::Vector3d& axis, double degrees) {
    return Transform{Eigen::AngleAxisd(degrees * kDegree, axis).toRotationMatrix(), {0, 0, 0}};
  };
  const auto shift = [](double x_m) {
    return Transform{Eigen::Matrix3d::Identity(), {x_m, 0.0, 0.0}};
  };
  const auto y = Eigen::Vector3d::UnitY();
  const auto z = Eigen::Vector3d::UnitZ();
  for (const Transform& bend :
       {turn(y, 0.5), turn(y, 2.0), turn(y, -2.0), turn(z, 0.25), shift(0.015), shift(0.06)}) {
    for (const int split : {0, 2}) {
      map_ = markers_;
      LensWatch watch({}, options_, /*map_grows=*/true, &camera_, &knowledge_);
      EXPECT_EQ(framesUntilLearned(truth_, 150, &watch), -1);
      for (testing::SyntheticMarker& marker : map_) {
        if (marker.T_w_m.p[split] > 0.0) marker.T_w_m = bend * marker.T_w_m;
      }
      EXPECT_EQ(framesUntilLearned(truth_, 150, &watch), -1);
      ASSERT_EQ(camera_.calibration(), truth_.calibration()) << bend.p.x() << " m, " << split;
    }
  }
}

// A map that grows together with a lens that is still being learned changes with it.
TEST_F(LensWatchTest, ALensThatIsBeingLearnedIsNotWatchedWhileTheMapGrows) {
  LensWatch watch({}, options_, /*map_grows=*/true, &camera_, &knowledge_);
  EXPECT_EQ(framesUntilLearned(truth_, 150, &watch), -1);
  knowledge_.state = LensState::kLearning;
  EXPECT_EQ(framesUntilLearned(scaled(truth_, 1.03, 0.0), 150, &watch), -1);
  knowledge_.state = LensState::kLearned;
  EXPECT_GT(framesUntilLearned(scaled(truth_, 1.03, 0.0), 150, &watch), 0);
}

}  // namespace
}  // namespace waymark::slam
