#include "slam/feature_stage.h"

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/natural/filter/testing_textured_wall.h"
#include "slam/slam.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kRate_hz = 30.0;
constexpr double kSize_m = 0.3;

// The dolly before a wall with one marker, from a map that begins with it, and on without it.
class FeatureStageTest : public ::testing::Test {
 protected:
  struct Told {
    double nees = 0.0;  // the world is the first keyframe's camera
    // Variance of the attitude: of the pose relative to the marker, of the marker in the world.
    double by_view = 0.0;
    double by_marker = 0.0;
  };
  enum class See { kMarker, kWallOnly, kNothing };
  // What is said of the k-th frame.
  FrameResult step(Slam* slam, const Transform& truth, int k, See see, std::mt19937* rng) {
    wall_.render(camera_, truth, 2.0, static_cast<unsigned>(k), &pixels_);
    if (see == See::kNothing) std::fill(pixels_.begin(), pixels_.end(), std::uint8_t{5});
    std::vector<MarkerDetection> seen;
    if (see == See::kMarker) {
      const auto detection = testing::observe(camera_, truth, 7, marker_, kSize_m, 0.06, rng);
      EXPECT_TRUE(detection);
      seen = {*detection};
    }
    const ImageView image{pixels_.data(), camera_.width(), camera_.height(), camera_.width()};
    FrameResult result = slam->process(
        {.time = {static_cast<std::uint64_t>(k), static_cast<std::int64_t>(1e9 * k / kRate_hz)},
         .image = image,
         .detections = seen});
    result.detections = {};  // they end here
    return result;
  }
  // What a new SLAM says of the last of so many frames with the marker and without it.
  FrameResult process(Slam* slam, const testing::Dolly& dolly, int with, int without) {
    std::mt19937 rng(dolly.seed);
    FrameResult result;
    for (int k = 0; k < with + without; ++k) {
      const See see = k < with ? See::kMarker : See::kWallOnly;
      result = step(slam, dolly.at(k / kRate_hz), k, see, &rng);
    }
    return result;
  }
  // Of the pose then.
  Told toldAfter(unsigned seed, int with, int without) {
    Slam slam(camera_, *Dictionary::byName("4X4_50"), options_);
    const testing::Dolly dolly{.speed_m_per_s = 0.4, .seed = seed};
    const FrameResult result = process(&slam, dolly, with, without);
    if (!result.pose || slam.map().keyframes().empty()) {
      ADD_FAILURE() << "no pose, seed " << seed;
      return {};
    }
    EXPECT_EQ(result.pose->source, PoseSource::kNaturalFeatures);
    const Keyframe& first = slam.map().keyframes().begin()->second;
    const Transform T_w_scene =
        first.T_w_c * dolly.at(static_cast<double>(first.sequence) / kRate_hz).inverse();
    const Vector6d error =
        result.pose->T_w_c.localCoordinates(T_w_scene * dolly.at((with + without - 1) / kRate_hz));
    const auto attitude = [](const Matrix6d& C) { return C.bottomRightCorner<3, 3>().trace(); };
    return {error.dot(result.pose->covariance.ldlt().solve(error)),
            attitude(result.pose->view_covariance),
            attitude(slam.map().findPosed(7)->world_covariance)};
  }

  FeatureStageTest() { options_.markers.size_m = kSize_m; }

  Options options_;
  CameraModel camera_{testing::wideCalibration(320, 240)};
  testing::TexturedWall wall_{3};
  Transform marker_ = testing::markerFacing({0.0, -0.005, 0.1}, {-0.6, -1.0, 0.1});
  std::vector<std::uint8_t> pixels_;
};

// What the first view leaves open of the only marker's place is the world's doubt, and in the
// pose's covariance once.
TEST_F(FeatureStageTest, AfterTheOnlyMarkerThePoseKnowsItsError) {
  constexpr int kSeeds = 20;
  double nees = 0.0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Told told = toldAfter(seed, 45, 5);
    nees += told.nees / kSeeds;
    EXPECT_LT(told.by_view, 0.5 * told.by_marker) << "seed " << seed;
  }
  std::printf("NEES %.2f\n", nees);
  // The corners' noise is white here, and believed to be the same from view to view in part.
  EXPECT_GT(nees, 6.0 / (1.75 * 1.75));
  EXPECT_LT(nees, 6.0 * 1.5 * 1.5);
}

TEST_F(FeatureStageTest, BeginsAtAMarkerWithinTheLimitsOnly) {
  const auto isCarried = [&] {
    Slam slam(camera_, *Dictionary::byName("4X4_50"), options_);
    const bool carried = process(&slam, {.speed_m_per_s = 0.4, .seed = 1}, 45, 5).pose.has_value();
    EXPECT_TRUE(carried || slam.counters().starts_outside > 0) << "nobody would know why";
    return carried;
  };
  EXPECT_TRUE(isCarried());
  options_.natural.integrator.start.min_area = 0.5;
  EXPECT_FALSE(isCarried());
  options_.natural.integrator.start.min_area = 0.01;
  EXPECT_TRUE(isCarried());
  options_.natural.integrator.start.border = 0.45;
  EXPECT_FALSE(isCarried());
}

// No carried pose is known as well as that.
TEST_F(FeatureStageTest, ACameraWhosePoseIsTooUncertainIsLostUntilAMarkerBringsItBack) {
  options_.natural.integrator.max_error_m = 1e-5;
  Slam slam(camera_, *Dictionary::byName("4X4_50"), options_);
  const testing::Dolly dolly{.speed_m_per_s = 0.4, .seed = 1};
  EXPECT_EQ(process(&slam, dolly, 45, 0).state, TrackingState::kTracking);
  std::mt19937 rng(1);
  int frame = 45;
  int place = 44;
  const auto expectLost = [&](int frames, See see) {
    for (int i = 0; i < frames; ++i, ++frame) {
      place += see == See::kNothing ? 0 : 1;
      const FrameResult result = step(&slam, dolly.at(place / kRate_hz), frame, see, &rng);
      EXPECT_FALSE(result.pose) << frame;
      EXPECT_EQ(result.state, TrackingState::kLost) << frame;
      EXPECT_EQ(result.reason, NoPoseReason::kCarriedTooUncertain) << frame;
    }
  };
  expectLost(5, See::kWallOnly);
  EXPECT_EQ(slam.counters().uncertain_frames, 5U);
  // Longer than features are looked for in the dark: nothing is followed any more.
  expectLost(75, See::kNothing);
  EXPECT_LT(slam.counters().uncertain_frames, 15U) << "soon there was nothing to be uncertain of";
  FrameResult back;
  for (int i = 0; i < 20; ++i, ++frame) {
    back = step(&slam, dolly.at(++place / kRate_hz), frame, See::kMarker, &rng);
  }
  EXPECT_TRUE(back.pose);
  EXPECT_EQ(back.state, TrackingState::kTracking);
  EXPECT_EQ(back.reason, NoPoseReason::kNone);
}

}  // namespace
}  // namespace waymark::slam
