#include "slam/natural/pose_integrator.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/camera_pose/pose_optimizer.h"
#include "slam/natural/filter/testing_textured_wall.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kRate_hz = 30.0;

// A camera on the dolly before a textured wall with one marker, and the integrator's frames.
class PoseIntegratorTest : public ::testing::Test {
 protected:
  struct Frame {
    std::optional<PoseEstimate> pose;  // as published
    bool followed = false;             // its markers were believed
  };
  enum class See { kAll, kWallOnly, kNothing };

  void SetUp() override {
    options_.enabled = true;
    dolly_.seed = 3;
  }

  // offset_m: how far the marker seems to be from where it is.
  Frame step(See see, double offset_m = 0.0) {
    if (!integrator_) integrator_.emplace(options_, camera_, &counters_);
    const double t = frame_ / kRate_hz;
    truth_ = dolly_.at(t);
    wall_.render(camera_, truth_, 2.0, static_cast<unsigned>(frame_), &pixels_);
    if (see == See::kNothing) std::fill(pixels_.begin(), pixels_.end(), std::uint8_t{5});
    const ImageView image{pixels_.data(), camera_.width(), camera_.height(), camera_.width()};
    const auto time_ns = static_cast<std::int64_t>(1e9 * t);
    ++frame_;
    if (see != See::kAll) return {bridge(time_ns, image), false};
    const auto seen = testing::observe(camera_, truth_, 7, marker_, kSize_m, 0.1, &rng_);
    EXPECT_TRUE(seen);
    Transform believed = marker_;
    believed.p.x() += offset_m;
    const KnownMarker known =
        testing::knownMarker(*seen, believed, kSize_m, Matrix6d::Identity() * 1e-8);
    Transform start = truth_;
    start.p.x() += offset_m;
    const auto solution = optimizer_.optimize({&known, 1}, start);
    EXPECT_TRUE(solution);
    PoseEstimate pose;
    pose.T_w_c = solution->T_w_c;
    pose.covariance = pose.view_covariance = solution->covariance;
    pose.source = PoseSource::kMarkers;
    const std::vector<KnownMarker> markers(static_cast<std::size_t>(markers_in_view_), known);
    if (integrator_->follow(time_ns, image, pose, true, markers)) return {pose, true};
    return {integrator_->bridge(time_ns, image), false};
  }
  std::optional<PoseEstimate> bridge(std::int64_t time_ns, const ImageView& image) {
    const auto seen = unplaced_
                          ? testing::observe(camera_, truth_, 8, *unplaced_, kSize_m, 0.1, &rng_)
                          : std::nullopt;
    if (!seen) return integrator_->bridge(time_ns, image);
    const UnplacedMarker marker = unplacedMarker(*seen, kSize_m, camera_.focalLength(), {});
    return integrator_->bridge(time_ns, image, {&marker, 1});
  }
  // With the marker in view.
  void begin(int frames = 20) {
    for (int i = 0; i < frames; ++i) ASSERT_TRUE(step(See::kAll).followed);
  }
  [[nodiscard]] double error_m(const PoseEstimate& pose) const {
    return (pose.T_w_c.p - truth_.p).norm();
  }

  static constexpr double kSize_m = 0.2;
  CameraModel camera_{testing::wideCalibration(320, 240)};
  testing::TexturedWall wall_{3};
  testing::Dolly dolly_;
  PoseOptimizer optimizer_{camera_.focalLength(), {}};
  Transform marker_ = testing::markerFacing({0.0, -0.005, 0.1}, {0.0, -1.0, 0.1});
  std::optional<Transform> unplaced_;  // a marker that no map knows, in frames without the other
  std::mt19937 rng_{3};
  NaturalOptions options_;
  Counters counters_;
  std::optional<PoseIntegrator> integrator_;
  std::vector<std::uint8_t> pixels_;
  Transform truth_;
  int frame_ = 0;
  int markers_in_view_ = 1;
};

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

TEST_F(PoseIntegratorTest, OffItIsNotThere) {
  options_.enabled = false;
  begin(2);
  EXPECT_FALSE(step(See::kWallOnly).pose);
}

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
