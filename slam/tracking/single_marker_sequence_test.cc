#include "slam/tracking/single_marker_sequence.h"

#include <cmath>
#include <utility>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

constexpr std::int64_t kStep_ns = 33'333'333;

// A camera that goes slowly past markers: its true pose, and the other one of a marker, which is a
// metre and half a radian away.
class SingleMarkerSequenceTest : public ::testing::Test {
 protected:
  [[nodiscard]] static Transform truthAt(int i) {
    Transform T;
    T.p = {0.01 * i, 0.0, 0.0};
    return T;
  }
  // Different markers put it at different places.
  [[nodiscard]] static Transform otherAt(int i, int marker) {
    Vector6d away;
    away << -0.01 * i, 1.0, 0.8 * marker, 0.0, 0.5, 0.2 * marker;
    return truthAt(i).retract(away);
  }
  [[nodiscard]] static SequenceFrame ofOne(int i, int marker, double log_odds_of_truth = 0.0) {
    SequenceFrame frame{.time_ns = i * kStep_ns, .poses = 2, .marker = marker};
    frame.T_w_c = {truthAt(i), otherAt(i, marker)};
    frame.covariance.fill(1e-4 * Matrix6d::Identity());
    frame.log_odds = log_odds_of_truth;
    frame.barrier = 100.0;
    return frame;
  }
  [[nodiscard]] static SequenceFrame ofSeveral(int i) {
    SequenceFrame frame{.time_ns = i * kStep_ns, .poses = 1};
    frame.T_w_c[0] = truthAt(i);
    frame.covariance[0] = 1e-5 * Matrix6d::Identity();
    return frame;
  }
  [[nodiscard]] std::vector<double> odds() const { return logOddsOfFirst(frames_, options_); }

  std::vector<SequenceFrame> frames_;
  SingleMarkerSequenceOptions options_;
};

TEST_F(SingleMarkerSequenceTest, WhatEachImageSaysAddsUpForAll) {
  for (int i = 0; i < 12; ++i) frames_.push_back(ofOne(i, 1, i == 3 ? -1.0 : 0.9));
  for (const double value : odds()) EXPECT_NEAR(value, 11 * 0.9 - 1.0, 0.01);
}

// In each image the likelier pose comes first, whichever that is.
TEST_F(SingleMarkerSequenceTest, TheOrderInAFrameDoesNotMatter) {
  for (int i = 0; i < 12; ++i) {
    frames_.push_back(ofOne(i, 1, 1.0));
    if (i % 3 == 0) std::swap(frames_.back().T_w_c[0], frames_.back().T_w_c[1]);
    if (i % 3 == 0) frames_.back().log_odds = -1.0;
  }
  const auto values = odds();
  for (int i = 0; i < 12; ++i) {
    EXPECT_NEAR(values[static_cast<std::size_t>(i)], i % 3 == 0 ? -12.0 : 12.0, 0.01) << i;
  }
}

TEST_F(SingleMarkerSequenceTest, SeveralMarkersDecideForThoseBeforeAndAfter) {
  for (int i = 0; i < 20; ++i) frames_.push_back(i == 10 ? ofSeveral(i) : ofOne(i, 1, -0.2));
  const auto values = odds();
  for (std::size_t i = 0; i < 20; ++i) {
    if (i == 10) {
      EXPECT_EQ(values[i], 0.0) << "it has one pose only";
    } else {
      EXPECT_GT(values[i], options_.judge.min_log_odds) << i;
    }
  }
}

// No image says anything; but the camera cannot have jumped from where one marker puts it to where
// the other does.
TEST_F(SingleMarkerSequenceTest, TwoMarkersInTurnDecideForEachOther) {
  for (int i = 0; i < 10; ++i) frames_.push_back(ofOne(i, 1));
  for (const double value : odds()) EXPECT_NEAR(value, 0.0, 1e-9);
  for (int i = 10; i < 20; ++i) frames_.push_back(ofOne(i, 2));
  for (const double value : odds()) EXPECT_GT(value, options_.judge.min_log_odds);
}

TEST_F(SingleMarkerSequenceTest, AStepSaysNoMoreThanItsLimit) {
  frames_ = {ofSeveral(0), ofOne(1, 1)};
  EXPECT_LE(odds()[1], 0.5 * options_.max_step_chi2);
  EXPECT_GT(odds()[1], options_.judge.min_log_odds);
  // Both poses impossible: nothing is said for the one that is a little less so.
  frames_[0].T_w_c[0].p.y() = -50.0;
  EXPECT_NEAR(odds()[1], 0.0, 1e-9);
}

// Frames of before and after in which the poses are not two: what was which has to be told by how
// far the camera can have moved.
TEST_F(SingleMarkerSequenceTest, WhereThePosesAreNotTwoNothingIsPassedOnByLikeness) {
  for (int i = 0; i < 30; ++i) frames_.push_back(ofOne(i, 1, i < 10 ? 3.0 : 0.0));
  for (int i = 10; i < 20; ++i) frames_[static_cast<std::size_t>(i)].barrier = 1.0;
  auto values = odds();
  for (std::size_t i = 10; i < 20; ++i) EXPECT_EQ(values[i], 0.0) << i;
  EXPECT_GT(values[25], 1.0) << "a metre in a third of a second";
  EXPECT_LT(values[25], values[5]);
  for (int i = 20; i < 30; ++i) frames_[static_cast<std::size_t>(i)].time_ns += 60'000'000'000;
  values = odds();
  EXPECT_NEAR(values[25], 0.0, 0.01);
  EXPECT_GT(values[5], 20.0);
}

TEST_F(SingleMarkerSequenceTest, AfterALongGapNothingIsKnown) {
  for (int i = 0; i < 10; ++i) frames_.push_back(ofSeveral(i));
  frames_.push_back(ofOne(3000, 1));
  EXPECT_NEAR(odds().back(), 0.0, 0.1);
}

TEST_F(SingleMarkerSequenceTest, ATimeThatGoesBackBeginsAnew) {
  for (int i = 0; i < 10; ++i) frames_.push_back(ofSeveral(100 + i));
  frames_.push_back(ofOne(0, 1));
  EXPECT_EQ(odds().back(), 0.0);
}

// A whole sequence that once was wrong is given up when the images go on to speak against it.
TEST_F(SingleMarkerSequenceTest, AWrongNeighbourIsOutvoted) {
  frames_.push_back(ofSeveral(0));
  frames_[0].T_w_c[0] = otherAt(0, 1);
  for (int i = 1; i < 200; ++i) frames_.push_back(ofOne(i, 1, 0.5));
  EXPECT_GT(odds()[100], options_.judge.min_log_odds);
}

TEST_F(SingleMarkerSequenceTest, DegenerateInput) {
  EXPECT_TRUE(odds().empty());
  frames_.resize(3);
  EXPECT_EQ(odds(), std::vector<double>(3, 0.0));
  for (SequenceFrame& frame : frames_) {
    frame.poses = 2;
    frame.barrier = 100.0;
    frame.covariance.fill(Matrix6d::Zero());
  }
  for (const double value : odds()) EXPECT_NEAR(value, 0.0, 1e-9) << "both poses the same";
}

TEST_F(SingleMarkerSequenceTest, OptionsAreChecked) {
  EXPECT_EQ(options_.invalidReason(), "");
  options_.speed_m_s = 0.0;
  EXPECT_EQ(options_.invalidReason(), "speed_m_s must be positive");
  options_ = {.judge = {.max_log_odds = 1.0}};
  EXPECT_NE(options_.invalidReason(), "");
}

}  // namespace
}  // namespace waymark::slam
