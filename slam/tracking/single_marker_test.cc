#include "slam/tracking/single_marker.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize_m = 0.12;
constexpr std::int64_t kFrame_ns = 33'333'333;

// One marker 17 pixels wide, seen from the side again and again.
class SingleMarkerTest : public ::testing::Test {
 protected:
  // The marker as seen from so far to its side, and what the map knows of it.
  const KnownMarker& look(double tilt_rad, double sigma_px = 0.1) {
    truth_ =
        testing::lookAt({distance_m_ * std::sin(tilt_rad), -distance_m_ * std::cos(tilt_rad), 0.1},
                        Eigen::Vector3d::Zero());
    detection_ = *testing::observe(camera_, truth_, 1, T_w_m_, kSize_m, sigma_px, &rng_);
    known_ = testing::knownMarker(detection_, T_w_m_, kSize_m);
    return known_;
  }

  [[nodiscard]] bool isTruth(const Transform& T_w_c) const {
    return rotationDistance(T_w_c.R, truth_.R) < 0.15;
  }

  double distance_m_ = 3.6;
  std::mt19937 rng_{11};
  CameraModel camera_{testing::testCalibration()};
  Transform T_w_m_ = testing::markerFacing(Eigen::Vector3d::Zero(), {0.0, -1.0, 0.0});
  Transform truth_;
  MarkerDetection detection_;
  KnownMarker known_;
  SingleMarkerOptions options_;
  SingleMarkerJudge judge_{camera_.focalLength(), options_, {}};
};

TEST_F(SingleMarkerTest, DecidesOnceTheFramesHaveSaidEnough) {
  int decided_at = -1;
  for (int i = 0; i < 200 && decided_at < 0; ++i) {
    const auto verdict = judge_.judge(look(0.45), i * kFrame_ns, {});
    ASSERT_TRUE(verdict);
    EXPECT_EQ(verdict->decided, verdict->log_odds >= options_.min_log_odds);
    if (!verdict->decided) continue;
    decided_at = i;
    EXPECT_TRUE(isTruth(verdict->T_w_c));
    EXPECT_FALSE(isTruth(verdict->other_T_w_c));
  }
  EXPECT_GT(decided_at, 0) << "one image does not say it";
}

// Never in 300 tracks: a wrong decision is one in 3000.
TEST_F(SingleMarkerTest, DoesNotDecideForTheWrongOne) {
  int decided = 0;
  for (int track = 0; track < 300; ++track) {
    judge_.forget();
    for (int i = 0; i < 60; ++i) {
      const auto verdict = judge_.judge(look(0.3 + 0.001 * i, 0.15), i * kFrame_ns, {});
      ASSERT_TRUE(verdict);
      if (!verdict->decided) continue;
      ++decided;
      EXPECT_TRUE(isTruth(verdict->T_w_c)) << "track " << track << ", frame " << i;
      break;
    }
  }
  EXPECT_GT(decided, 100);
}

TEST_F(SingleMarkerTest, WhatSeveralMarkersSaidBeforeDecides) {
  (void)look(0.45);
  const auto alone = judge_.judge(known_, 0, {});
  ASSERT_TRUE(alone);
  EXPECT_FALSE(alone->decided);
  for (const bool truth : {true, false}) {
    judge_.forget();
    const Transform expected = isTruth(alone->T_w_c) == truth ? alone->T_w_c : alone->other_T_w_c;
    const auto verdict = judge_.judge(known_, 0, expected);
    ASSERT_TRUE(verdict);
    EXPECT_TRUE(verdict->decided);
    EXPECT_EQ(isTruth(verdict->T_w_c), truth);
  }
}

// What was believed wrongly is given up when the images go on to speak against it.
TEST_F(SingleMarkerTest, ChangesItsMind) {
  (void)look(0.6);
  const auto alone = judge_.judge(known_, 0, {});
  ASSERT_TRUE(alone);
  judge_.forget();
  const Transform wrong = isTruth(alone->T_w_c) ? alone->other_T_w_c : alone->T_w_c;
  bool corrected = false;
  for (int i = 0; i < 300 && !corrected; ++i) {
    const auto verdict = judge_.judge(look(0.6), i * kFrame_ns, wrong);
    ASSERT_TRUE(verdict);
    corrected = verdict->decided && isTruth(verdict->T_w_c);
  }
  EXPECT_TRUE(corrected);
}

// From the front, the corners allow all poses between the two: none of them is decided for.
TEST_F(SingleMarkerTest, FromTheFrontNothingIsDecided) {
  for (int i = 0; i < 100; ++i) {
    const auto verdict = judge_.judge(look(0.02), i * kFrame_ns, truth_);
    if (!verdict) continue;
    EXPECT_FALSE(verdict->decided) << i;
  }
}

// Nearer by, all poses towards the other one fit the image less and less: it is no pose of its own.
TEST_F(SingleMarkerTest, AnImageThatFitsOneOnlyDecides) {
  distance_m_ = 0.5;
  int decided = 0;
  for (int run = 0; run < 200; ++run) {
    judge_.forget();
    const auto verdict = judge_.judge(look(0.06, 0.05), 0, {});
    ASSERT_TRUE(verdict);
    const auto view = viewSingleMarker(known_, camera_.focalLength(), {});
    ASSERT_TRUE(view);
    if (!verdict->decided || view->barrier >= options_.min_barrier) continue;
    ++decided;
    EXPECT_LT(rotationDistance(verdict->T_w_c.R, truth_.R), 0.04) << run;
    EXPECT_GT(verdict->barrier, options_.min_barrier) << "all but the other pose speaks against it";
  }
  EXPECT_GT(decided, 50);
}

TEST_F(SingleMarkerTest, AGapOrAnotherMarkerBeginsAnew) {
  ASSERT_TRUE(judge_.judge(look(0.6), 0, truth_)->decided);
  EXPECT_FALSE(judge_.judge(look(0.45), 600'000'000, {})->decided);
  judge_.forget();
  ASSERT_TRUE(judge_.judge(look(0.6), 0, truth_)->decided);
  (void)look(0.45);
  detection_.id = 2;
  EXPECT_FALSE(judge_.judge(known_, kFrame_ns, {})->decided);
}

TEST_F(SingleMarkerTest, ItsOptionsAreChecked) {
  EXPECT_EQ(options_.invalidReason(), "");
  options_.max_log_odds = 1.0;
  EXPECT_NE(options_.invalidReason(), "");
}

}  // namespace
}  // namespace waymark::slam
