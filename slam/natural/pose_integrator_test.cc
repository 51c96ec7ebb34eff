#include "slam/natural/pose_integrator.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/natural/testing_pose_integrator.h"

namespace waymark::slam {
namespace {

using testing::PoseIntegratorTest;

TEST_F(PoseIntegratorTest, NothingWithoutAStartFromMarkers) {
  EXPECT_FALSE(step(See::kWallOnly).pose);
  EXPECT_FALSE(step(See::kNothing).pose);
}

TEST_F(PoseIntegratorTest, FeaturesCarryThePose) {
  begin();
  for (int i = 0; i < 60; ++i) {
    const Frame frame = step(See::kWallOnly);
    ASSERT_TRUE(frame.pose) << i;
    EXPECT_EQ(frame.pose->source, PoseSource::kNaturalFeatures);
    EXPECT_GE(frame.pose->features_used, options_.integrator.min_features);
    EXPECT_LT(error_m(*frame.pose), 0.05) << i;
    const Vector6d e = frame.pose->T_w_c.localCoordinates(truth_);
    EXPECT_LT(e.dot(frame.pose->covariance.ldlt().solve(e)), 30.0) << i;
  }
  EXPECT_EQ(counters_.bridged_frames, 60U);
  EXPECT_TRUE(step(See::kAll).followed) << "the marker agrees when it is seen again";
  EXPECT_EQ(counters_.filter_restarts, 0U);
}

TEST_F(PoseIntegratorTest, FeaturesOfAGapAreCarriedOnUntilTheyBeginAnew) {
  begin();
  EXPECT_FALSE(integrator_->carriedOn()) << "no gap yet";
  for (int i = 0; i < 30; ++i) ASSERT_TRUE(step(See::kWallOnly).pose) << i;
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(step(See::kAll).followed) << i;
  const auto carried = integrator_->carriedOn();
  ASSERT_TRUE(carried);
  const Vector6d e = carried->T_w_c.localCoordinates(truth_);
  EXPECT_LT(e.dot(carried->covariance.ldlt().solve(e)), 30.0);
  integrator_->giveUp();
  EXPECT_FALSE(integrator_->carriedOn());
  ASSERT_TRUE(step(See::kAll).followed);
  EXPECT_FALSE(integrator_->carriedOn()) << "others are followed by now";
}

// Its size tells how far the camera goes.
TEST_F(PoseIntegratorTest, AMarkerWithoutAPlaceMakesThePoseSurer) {
  const auto sigma_m = [](const PoseEstimate& pose) {
    return std::sqrt(pose.covariance.topLeftCorner<3, 3>().trace());
  };
  double without_m = 0.0;
  for (const bool shown : {false, true}) {
    SetUp();
    integrator_.reset();
    frame_ = 0;
    begin(10);
    if (shown) unplaced_ = testing::markerFacing({0.1, -0.005, -0.2}, {0.1, -1.0, -0.2});
    Frame frame;
    for (int i = 0; i < 60; ++i) frame = step(See::kWallOnly);
    ASSERT_TRUE(frame.pose);
    const Vector6d e = frame.pose->T_w_c.localCoordinates(truth_);
    EXPECT_LT(e.dot(frame.pose->covariance.ldlt().solve(e)), 22.5) << shown;
    if (shown) {
      EXPECT_LT(sigma_m(*frame.pose), 0.7 * without_m);
    }
    without_m = sigma_m(*frame.pose);
  }
}

TEST_F(PoseIntegratorTest, InTheDarkMotionIsAPoseForAMomentOnly) {
  begin();
  int predicted = 0;
  for (int i = 0; i < 15; ++i) {
    const Frame frame = step(See::kNothing);
    if (!frame.pose) continue;
    EXPECT_EQ(frame.pose->source, PoseSource::kPrediction);
    EXPECT_EQ(frame.pose->features_used, 0);
    ++predicted;
  }
  EXPECT_GE(predicted, 1);
  EXPECT_LE(predicted, 6) << "0.2 s at 30 a second";
  EXPECT_EQ(counters_.predicted_frames, static_cast<std::uint64_t>(predicted));
  // The light comes back: what was known is found again.
  int found = 0;
  for (int i = 0; i < 20; ++i) {
    const Frame frame = step(See::kWallOnly);
    if (frame.pose && frame.pose->source == PoseSource::kNaturalFeatures) ++found;
  }
  EXPECT_GT(found, 15);
}

TEST_F(PoseIntegratorTest, GivesUpRatherThanLie) {
  options_.integrator.max_prediction_s = 10.0;
  begin();
  int posed = 0;
  int uncertain = 0;
  for (int i = 0; i < 75; ++i) {
    const Frame frame = step(See::kNothing);
    uncertain += integrator_->tooUncertain() ? 1 : 0;
    if (!frame.pose) continue;
    ++posed;
    EXPECT_LE(3.0 * std::sqrt(frame.pose->covariance.topLeftCorner<3, 3>().trace()), 0.5);
  }
  EXPECT_LT(posed, 30);
  EXPECT_GT(uncertain, 0);
  EXPECT_LT(posed + uncertain, 75) << "after max_blind_s there is nothing to be uncertain of";
  EXPECT_EQ(counters_.uncertain_frames, static_cast<std::uint64_t>(uncertain));
  EXPECT_FALSE(step(See::kWallOnly).pose) << "once given up, it takes markers to begin again";
}

// The same frames twice: the second time any scale counts as hardly known.
TEST_F(PoseIntegratorTest, AWayOfAnUnknownScaleIsLessCertainThanTheFilterSays) {
  struct Gap {
    std::optional<PoseEstimate> end, after;  // the same, and in a frame after one with a marker
  };
  const auto cross = [&] {
    integrator_.reset();
    rng_.seed(3);
    frame_ = 0;
    begin();
    Gap gap;
    for (int i = 0; i < 30; ++i) gap.end = step(See::kWallOnly).pose;
    EXPECT_TRUE(step(See::kAll).followed);
    gap.after = step(See::kWallOnly).pose;
    return gap;
  };
  const Gap told = cross();
  options_.integrator.unscaled_way.from_scale_sigma = 1e-6;
  const Gap doubted = cross();
  ASSERT_TRUE(told.end && told.after && doubted.end && doubted.after);
  EXPECT_LT((doubted.end->T_w_c.p - told.end->T_w_c.p).norm(), 1e-12);
  const Eigen::Matrix3d more =
      (doubted.end->covariance - told.end->covariance).topLeftCorner<3, 3>();
  const Eigen::Vector3d way = doubted.end->T_w_c.p - dolly_.at(20 / kRate_hz).p;
  // Only along the way, and by what the scale is in doubt: some percent of it.
  EXPECT_GT(way.normalized().dot(more * way.normalized()), 0.95 * more.trace());
  const double share = std::sqrt(more.trace()) / way.norm();
  EXPECT_GT(share, 0.002);
  EXPECT_LT(share, 0.05);
  // Where a marker was seen the place is known again.
  EXPECT_LT((doubted.after->covariance - told.after->covariance).norm(), 1e-12);
}

TEST_F(PoseIntegratorTest, WhatIsFusedIsNotGivenUpForOneContradiction) {
  begin();
  ASSERT_TRUE(integrator_->fused());
  EXPECT_LT(error_m(*integrator_->fused()), 0.05);
  const Frame contradicted = step(See::kAll, 0.4);
  EXPECT_FALSE(contradicted.followed);
  ASSERT_TRUE(contradicted.pose);
  EXPECT_LT(error_m(*contradicted.pose), 0.05);
  EXPECT_TRUE(step(See::kAll).followed);
  EXPECT_EQ(counters_.filter_restarts, 0U);
}

TEST_F(PoseIntegratorTest, OneContradictionIsNotBelievedThreeAre) {
  begin();
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(step(See::kWallOnly).pose);
  constexpr double kMoved_m = 0.4;
  EXPECT_FALSE(step(See::kAll, kMoved_m).followed);
  const Frame bridged = step(See::kAll, kMoved_m);
  EXPECT_FALSE(bridged.followed);
  ASSERT_TRUE(bridged.pose) << "the filter's goes on";
  EXPECT_LT(error_m(*bridged.pose), 0.05);
  EXPECT_TRUE(step(See::kAll, kMoved_m).followed) << "the third witness";
  EXPECT_EQ(counters_.filter_restarts, 1U);
}

// After a second in the dark the filter is uncertain enough not to contradict a marker that is not
// where its features are.
TEST_F(PoseIntegratorTest, AFilterAtOddsWithItsMarkersBeginsAnew) {
  begin();
  for (int i = 0; i < 30; ++i) (void)step(See::kNothing);
  constexpr double kOff_m = 0.1;
  int followed = 0;
  for (int i = 0; i < 12; ++i) followed += step(See::kAll, kOff_m).followed ? 1 : 0;
  EXPECT_EQ(followed, 12);
  EXPECT_GE(counters_.filter_restarts, 1U);
  for (int i = 0; i < 30; ++i) {
    const Frame frame = step(See::kWallOnly);
    ASSERT_TRUE(frame.pose) << i;
    EXPECT_NEAR(frame.pose->T_w_c.p.x() - truth_.p.x(), kOff_m, 0.03) << i;
  }
}

TEST_F(PoseIntegratorTest, FollowsTheWorldsCoordinates) {
  begin();
  ASSERT_TRUE(step(See::kWallOnly).pose);
  const Transform T_new_old{expSo3({0.0, 0.0, 0.3}), {1.0, 2.0, 3.0}};
  integrator_->moveWorld(T_new_old);
  const Frame frame = step(See::kWallOnly);
  ASSERT_TRUE(frame.pose);
  EXPECT_LT((frame.pose->T_w_c.p - (T_new_old * truth_).p).norm(), 0.05);
}

TEST_F(PoseIntegratorTest, APauseEndsIt) {
  begin();
  frame_ += 45;
  EXPECT_FALSE(step(See::kWallOnly).pose);
}

// The filter takes no time where no gap is to come, and is there once markers are few.
TEST_F(PoseIntegratorTest, ManyMarkersLeaveItIdle) {
  markers_in_view_ = 4;
  begin();
  EXPECT_FALSE(step(See::kWallOnly).pose) << "nothing had been followed";
  markers_in_view_ = 3;
  begin(10);
  EXPECT_TRUE(step(See::kWallOnly).pose);
  markers_in_view_ = 4;
  begin(10);
  EXPECT_TRUE(step(See::kWallOnly).pose) << "a third of a second is too short to let go";
  begin(25);
  EXPECT_FALSE(step(See::kWallOnly).pose);
}

TEST_F(PoseIntegratorTest, MarkersOutsideTheLimitsBeginNothingAndAreCounted) {
  beginning_ = Beginning::kOutside;
  begin(10);
  EXPECT_EQ(counters_.starts_outside, 10U);
  EXPECT_FALSE(step(See::kWallOnly).pose);
  beginning_ = Beginning::kAmbiguous;
  begin(10);
  EXPECT_EQ(counters_.starts_outside, 10U) << "these are refused for another reason";
  beginning_ = Beginning::kAllowed;
  begin(10);
  beginning_ = Beginning::kOutside;
  begin(10);
  EXPECT_EQ(counters_.starts_outside, 10U) << "what has begun goes on";
  EXPECT_TRUE(step(See::kWallOnly).pose);
}

TEST_F(PoseIntegratorTest, OffItIsNotThere) {
  options_.enabled = false;
  begin(2);
  EXPECT_FALSE(step(See::kWallOnly).pose);
}

TEST(NaturalOptions, WhatCannotWorkIsTold) {
  EXPECT_EQ(NaturalOptions{}.invalidReason(), "");
  NaturalOptions options;
  options.integrator.min_features = 2;
  EXPECT_NE(options.invalidReason(), "");
  options = {};
  options.integrator.witnesses = 0;
  EXPECT_NE(options.invalidReason(), "");
}

}  // namespace
}  // namespace waymark::slam
