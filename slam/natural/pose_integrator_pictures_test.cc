// The pose integrator and what others find in earlier frames: where pictures say that the camera
// was.
#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "slam/natural/pose_integrator.h"
#include "slam/natural/testing_pose_integrator.h"

namespace waymark::slam {
namespace {

using testing::PoseIntegratorTest;

// Frames of a picture's surface alone, every fifth of which is looked at elsewhere, with an answer
// five frames later; the camera moves on meanwhile.
class StartFromPictureTest : public PoseIntegratorTest {
 protected:
  struct Awaited {
    int frame = 0;
    Transform T_w_c;
  };

  // What is said of an awaited frame.
  [[nodiscard]] LatePose answer() const {
    const auto fix = [&](const Transform& T_w_c) {
      return LateFix{static_cast<std::uint64_t>(awaited_->frame), T_w_c,
                     sigma_ * sigma_ * Matrix6d::Identity()};
    };
    LatePose pose{.fix = fix(awaited_->T_w_c), .decided = decided_, .begins = begins_};
    if (other_rad_ == 0.0) return pose;
    pose.other = fix(turnedAboutPicture(awaited_->T_w_c, other_rad_));
    if (flipped_) std::swap(pose.fix, *pose.other);
    if (!tell_other_) pose.other.reset();
    return pose;
  }
  [[nodiscard]] Transform turnedAboutPicture(const Transform& T_w_c, double angle_rad) const {
    Transform turn;
    turn.R = Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    const Eigen::Vector3d middle(-0.5, 0.0, 0.0);
    turn.p = middle - turn.R * middle;
    return turn * T_w_c;
  }

  // answers: whether the one looked at was found.
  std::optional<PoseEstimate> stepAwaited(bool answers) {
    constexpr int kFramesPerLook = 5;
    if (awaited_ && frame_ % kFramesPerLook == 0 && answers) {
      outcome_ = integrator_->late(answer(), points_w_);
    }
    const int number = frame_;
    const auto pose = step(See::kWallOnly).pose;
    if (number % kFramesPerLook == 0) {
      const ImageView image{pixels_.data(), camera_.width(), camera_.height(), camera_.width()};
      integrator_->await(static_cast<std::uint64_t>(number),
                         static_cast<std::int64_t>(1e9 * number / kRate_hz), image,
                         pose.has_value());
      awaited_ = {number, truth_};
    }
    return pose;
  }
  void expectRight(const PoseEstimate& pose, double limit_m = 0.05) const {
    EXPECT_LT(error_m(pose), limit_m) << frame_;
    const Vector6d e = pose.T_w_c.localCoordinates(truth_);
    EXPECT_LT(e.dot(pose.covariance.ldlt().solve(e)), 30.0) << frame_;
  }

  // Of a poster on the wall.
  std::vector<Eigen::Vector3d> points_w_ = [] {
    std::vector<Eigen::Vector3d> points;
    for (const double x : {-0.2, -0.07, 0.07, 0.2}) {
      for (const double z : {-0.2, 0.0, 0.2}) points.emplace_back(x - 0.5, 0.0, z);
    }
    return points;
  }();
  double sigma_ = 0.002;    // of what is said of a frame, metres and radians
  double other_rad_ = 0.0;  // how far the plane's other pose is turned; 0: there is none
  bool flipped_ = false;    // the other one is taken for the right one
  bool tell_other_ = true;  // it is said that there are two
  bool decided_ = true;
  bool begins_ = true;  // the picture is within the limits of the image
  std::optional<Awaited> awaited_;
  LateOutcome outcome_ = LateOutcome::kUnknown;
};

TEST_F(StartFromPictureTest, BeginsWhereTwoViewsTellTheWayBetweenThem) {
  bool noted = false;
  bool begun = false;
  int posed = 0;
  for (int i = 0; i < 60; ++i) {
    const auto pose = stepAwaited(true);
    noted = noted || outcome_ == LateOutcome::kNoted;
    begun = begun || outcome_ == LateOutcome::kStarted;
    EXPECT_TRUE(noted || !begun) << "one view says nothing of how far the camera has gone since";
    if (!pose) continue;
    expectRight(*pose, begun ? 0.05 : 0.15);  // the scale is a guess until then
    ++posed;
  }
  EXPECT_GT(posed, 40);
}

TEST_F(StartFromPictureTest, GoesOnRightWhenThePictureIsGone) {
  bool begun = false;
  int posed = 0;
  for (int i = 0; i < 75; ++i) {
    const auto pose = stepAwaited(i < 20);
    begun = begun || outcome_ == LateOutcome::kStarted;
    if (!pose) continue;
    // The scale is a guess, then from four views of 2 mm within 0.2 m; the way is 1 m.
    expectRight(*pose, begun ? 0.12 : 0.15);
    ++posed;
  }
  EXPECT_GT(posed, 50);
}

// So few cameras are remembered that the first answer's is forgotten before the next one comes.
TEST_F(StartFromPictureTest, BeginsAlsoAfterALongTimeWithoutAnAnswer) {
  for (int i = 0; i < 8; ++i) (void)stepAwaited(true);
  ASSERT_EQ(outcome_, LateOutcome::kNoted);
  for (int i = 0; i < 30; ++i) (void)stepAwaited(false);
  bool begun = false;
  for (int i = 0; i < 25; ++i) {
    const auto pose = stepAwaited(true);
    begun = begun || outcome_ == LateOutcome::kStarted;
    if (!pose) continue;
    EXPECT_GT(pose->ambiguity_ratio, 1.0) << "a picture's other pose has been refuted";
    if (begun) expectRight(*pose);
  }
  EXPECT_TRUE(begun);
}

TEST_F(StartFromPictureTest, OneViewIsEnoughWhereTheCameraHardlyMoves) {
  dolly_.speed_m_per_s = 0.05;
  std::vector<LateOutcome> outcomes;
  for (int i = 0; i < 12; ++i) {
    const auto pose = stepAwaited(true);
    if (pose) expectRight(*pose);
    outcomes.push_back(outcome_);
  }
  EXPECT_EQ(std::ranges::count(outcomes, LateOutcome::kNoted), 0);
  EXPECT_GT(std::ranges::count(outcomes, LateOutcome::kStarted), 0);
}

// Its place is known, and better than the picture says: that this says another is noticed all the
// same.
TEST_F(StartFromPictureTest, APoseThatPicturesContradictIsGivenUp) {
  for (int i = 0; i < 30; ++i) (void)stepAwaited(true);
  sigma_ = 0.02;
  for (int i = 0; i < 10; ++i) (void)stepAwaited(true);
  ASSERT_EQ(outcome_, LateOutcome::kKnown);
  Transform moved;
  moved.p = {0.3, 0.0, 0.0};
  integrator_->moveWorld(moved);  // it is wrong by now
  int refused = 0;
  bool begun = false;
  for (int i = 0; i < 60; ++i) {
    outcome_ = LateOutcome::kUnknown;
    const auto pose = stepAwaited(true);
    if (outcome_ == LateOutcome::kRefused) ++refused;
    begun = begun || outcome_ == LateOutcome::kStarted;
    if (begun && pose) expectRight(*pose, 0.1);  // the pictures say 35 mm
  }
  EXPECT_EQ(refused, options_.integrator.witnesses - 1);
  EXPECT_TRUE(begun);
}

TEST_F(StartFromPictureTest, WhileAPictureContradictsEitherMayBeRight) {
  for (int i = 0; i < 40; ++i) (void)stepAwaited(true);
  Transform moved;
  moved.p = {0.12, 0.0, 0.0};
  integrator_->moveWorld(moved);  // it is wrong by now
  int doubted = 0;
  outcome_ = LateOutcome::kUnknown;
  for (int i = 0; i < 60 && outcome_ != LateOutcome::kStarted; ++i) {
    const auto pose = stepAwaited(true);
    if (outcome_ != LateOutcome::kRefused) continue;
    ASSERT_TRUE(pose);
    const Vector6d e = pose->T_w_c.localCoordinates(truth_);
    EXPECT_GT(e.head<3>().norm(), 0.08);
    EXPECT_LT(e.dot(pose->covariance.ldlt().solve(e)), 16.8) << "99 % of chi-square of 6";
    ++doubted;
  }
  EXPECT_GE(doubted, 5);
  EXPECT_EQ(outcome_, LateOutcome::kStarted);
}

// A picture that is small and far: of its two poses, 50 mrad apart, now the one and now the other
// looks better, and is said to be surely the right one.
TEST_F(StartFromPictureTest, APoseThatAgreesWithAPicturesOtherOneIsKept) {
  for (int i = 0; i < 40; ++i) (void)stepAwaited(true);
  other_rad_ = 0.05;
  int posed = 0;
  for (int i = 0; i < 45; ++i) {
    flipped_ = i % 15 < 10;
    outcome_ = LateOutcome::kUnknown;
    const auto pose = stepAwaited(true);
    EXPECT_NE(outcome_, LateOutcome::kStarted) << i;
    EXPECT_NE(outcome_, LateOutcome::kRefused) << i;
    if (!pose) continue;
    expectRight(*pose);
    ++posed;
  }
  EXPECT_EQ(posed, 45);
}

// Nobody says that there are two: contradictions that contradict each other are no witnesses, until
// there have been too many of them.
TEST_F(StartFromPictureTest, WitnessesMustAgree) {
  for (int i = 0; i < 40; ++i) (void)stepAwaited(true);
  tell_other_ = false;
  flipped_ = true;
  int refused = 0;
  for (int i = 0; i < 25; ++i) {
    other_rad_ = i % 10 < 5 ? 0.05 : -0.05;
    outcome_ = LateOutcome::kUnknown;
    const auto pose = stepAwaited(true);
    EXPECT_NE(outcome_, LateOutcome::kStarted) << i;
    if (outcome_ == LateOutcome::kRefused) ++refused;
    if (pose) expectRight(*pose);
  }
  EXPECT_GT(refused, options_.integrator.witnesses);
}

// It tells who has a pose already how wrong that may be, but not where to begin.
TEST_F(StartFromPictureTest, NothingBeginsAtAPictureThatIsOutsideTheLimits) {
  begins_ = false;
  for (int i = 0; i < 40; ++i) EXPECT_FALSE(stepAwaited(true));
  EXPECT_EQ(outcome_, LateOutcome::kOutside);
  begins_ = true;
  for (int i = 0; i < 40; ++i) (void)stepAwaited(true);
  begins_ = false;
  Transform moved;
  moved.p = {0.3, 0.0, 0.0};
  integrator_->moveWorld(moved);  // it is wrong by now
  int refused = 0;
  for (int i = 0; i < 60; ++i) {
    outcome_ = LateOutcome::kUnknown;
    (void)stepAwaited(true);
    EXPECT_NE(outcome_, LateOutcome::kStarted) << i;
    if (outcome_ == LateOutcome::kRefused) ++refused;
  }
  EXPECT_GT(refused, 2 * options_.integrator.witnesses);
}

TEST_F(StartFromPictureTest, AnOpenPoseIsOfUseToWhoKnowsBetterOnly) {
  decided_ = false;
  other_rad_ = 0.05;
  for (int i = 0; i < 40; ++i) EXPECT_FALSE(stepAwaited(true)) << "nothing tells which it is";
  EXPECT_EQ(outcome_, LateOutcome::kOpen);
  decided_ = true;
  for (int i = 0; i < 40; ++i) (void)stepAwaited(true);
  ASSERT_TRUE(outcome_ == LateOutcome::kUsed || outcome_ == LateOutcome::kKnown);
  // Then of either the right one is taken.
  decided_ = false;
  sigma_ = 0.0005;
  for (int i = 0; i < 10; ++i) {
    flipped_ = i >= 5;
    outcome_ = LateOutcome::kUnknown;
    const auto pose = stepAwaited(true);
    if (i % 5 == 0) EXPECT_EQ(outcome_, LateOutcome::kUsed) << i;
    ASSERT_TRUE(pose);
    expectRight(*pose);
  }
}

}  // namespace
}  // namespace waymark::slam
