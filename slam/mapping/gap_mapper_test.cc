#include "slam/mapping/gap_mapper.h"

#include <random>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/geometry/turned_covariance.h"
#include "slam/testing/scene.h"

namespace waymark::slam {
namespace {

using testing::kFramePeriodNs;

constexpr double kSize_m = 0.15;
constexpr int kAnchor = 3;
constexpr int kNew = 8;

// Marker 3 is in the map; marker 8, some metres further, comes into view.
class GapMapperTest : public ::testing::Test {
 protected:
  GapMapperTest() {
    markers_.size_m = kSize_m;
    map_.addMarker(kAnchor, kSize_m);
    map_.place(kAnchor, T_w_anchor_);
    covariance_.diagonal() << 4e-6, 4e-6, 4e-6, 1e-6, 1e-6, 1e-6;
  }

  // The camera at x, where the features say it is `error` away from there.
  std::optional<GapJoint> look(double x_m, const Vector6d& error = Vector6d::Zero(),
                               std::int64_t pause_ns = kFramePeriodNs) {
    const Eigen::Vector3d eye(x_m, 0.0, 0.0);
    const Transform T_w_c = testing::lookAt(eye, eye + Eigen::Vector3d(0.1, 1.0, 0.0));
    seen_ = testing::observeAll(camera_, T_w_c, {{kNew, T_w_new_}}, kSize_m, 0.05, &rng_);
    EXPECT_EQ(seen_.size(), 1U) << "out of view";
    time_ns_ += pause_ns;
    return mapper_.offer(
        {{++sequence_, time_ns_}, seen_, T_w_c.retract(error), covariance_, Twist::Zero(), anchor_},
        map_, 1.0);
  }

  // How many looks, 7 cm apart, it takes; 0 for more than 12.
  int looksUntilDecided() {
    for (int i = 1; i <= 12; ++i) {
      joint_ = look(2.5 + 0.07 * i);
      if (joint_) return i;
    }
    return 0;
  }

  // 0.1 m apart, but for features twice as far.
  void lookTooFar() {
    for (int i = 1; i <= 12 && !joint_; ++i) {
      const double way_m = 0.1 * i;
      Vector6d too_far = Vector6d::Zero();
      too_far.x() = way_m;
      joint_ = look(2.5 + way_m, too_far);
    }
  }

  std::mt19937 rng_{7};
  CameraModel camera_{testing::testCalibration()};
  Transform T_w_anchor_ = testing::markerFacing({0.0, 1.5, 0.1}, {0.2, 0.0, 0.0});
  Transform T_w_new_ = testing::markerFacing({3.2, 1.4, 0.0}, {3.6, 0.0, 0.3});
  MarkerOptions markers_;
  MarkerResolverOptions resolver_;
  GapMapperOptions options_;
  GapMapper mapper_{markers_, camera_.focalLength(), resolver_, options_};
  Map map_;
  Matrix6d covariance_ = Matrix6d::Zero();
  int anchor_ = kAnchor;
  std::vector<MarkerDetection> seen_;
  std::optional<GapJoint> joint_;
  std::uint64_t sequence_ = 0;
  std::int64_t time_ns_ = 0;
};

TEST_F(GapMapperTest, ANewMarkerComesWithLinksToTheAnchor) {
  EXPECT_GE(looksUntilDecided(), static_cast<int>(options_.views));
  ASSERT_TRUE(joint_);
  EXPECT_EQ(joint_->marker.id, kNew);
  EXPECT_LT((joint_->marker.T_w_m.p - T_w_new_.p).norm(), 0.005);
  EXPECT_LT(rotationDistance(joint_->marker.T_w_m.R, T_w_new_.R), 0.03);
  ASSERT_EQ(joint_->keyframes.size(), options_.views);
  EXPECT_EQ(joint_->keyframes.back().sequence, sequence_);
  EXPECT_EQ(joint_->keyframes.back().monotonic_ns, time_ns_);
  // Together they say what one of them would.
  const auto alone = linkTo(kAnchor, T_w_anchor_, joint_->keyframes[0].T_w_c, covariance_);
  const double links = static_cast<double>(options_.views + options_.nearer_views);
  EXPECT_TRUE(joint_->keyframes[0].links.at(0).covariance.isApprox(links * alone->covariance));
  for (const Keyframe& keyframe : joint_->keyframes) {
    EXPECT_NE(keyframe.find(kNew), nullptr);
    ASSERT_EQ(keyframe.links.size(), 1U);
    EXPECT_EQ(keyframe.links[0].marker, kAnchor);
    const Transform T_w_anchor = keyframe.T_w_c * keyframe.links[0].T_c_m;
    EXPECT_LT((T_w_anchor.p - T_w_anchor_.p).norm(), 1e-12);
    EXPECT_LT(rotationDistance(T_w_anchor.R, T_w_anchor_.R), 1e-7);
  }
}

// Its scale has drifted, as it may: the camera is carried twice as far as it goes. No pose of the
// marker explains that, but each view has one.
TEST_F(GapMapperTest, CarriedPosesAtOddsWithThemselvesGiveTheClearestView) {
  covariance_(0, 0) = 0.3 * 0.3;
  lookTooFar();
  ASSERT_TRUE(joint_);
  ASSERT_EQ(joint_->keyframes.size(), 1U);
  const Keyframe& keyframe = joint_->keyframes.front();
  ASSERT_EQ(keyframe.detections.size(), 1U);
  const auto alone =
      estimateSquarePose(keyframe.detections.front(), kSize_m, camera_.focalLength());
  ASSERT_TRUE(alone);
  EXPECT_GT(alone->ratio, resolver_.ambiguity_ratio);
  const Transform T_c_m = keyframe.T_w_c.inverse() * joint_->marker.T_w_m;
  EXPECT_LT((T_c_m.p - alone->T_c_m[0].p).norm(), 1e-9);
  EXPECT_EQ(joint_->marker.other_T_w_m.has_value(), alone->ratio <= resolver_.final_ratio);
  ASSERT_EQ(keyframe.links.size(), 1U) << "which nothing else shares";
  const double links = static_cast<double>(1 + options_.nearer_views);
  const auto link = linkTo(kAnchor, T_w_anchor_, keyframe.T_w_c, covariance_);
  EXPECT_TRUE(keyframe.links[0].covariance.isApprox(links * link->covariance));
}

// The same where features know the camera's place to 2 mm: what is seen is no marker of that size.
TEST_F(GapMapperTest, ASquareThatPreciseCarriedPosesContradictIsNone) {
  lookTooFar();
  EXPECT_FALSE(joint_);
}

// Three views decide, and there will be no more of them.
TEST_F(GapMapperTest, AMarkerOutOfSightJoinsWithWhatThereIs) {
  for (int i = 0; i < 3; ++i) ASSERT_FALSE(look(2.6 + 0.2 * i));
  const auto nothingInView = [&](std::int64_t later_ns) {
    time_ns_ += later_ns;
    return mapper_.offer(
        {{++sequence_, time_ns_}, {}, Transform{}, covariance_, Twist::Zero(), anchor_}, map_, 1.0);
  };
  EXPECT_FALSE(nothingInView(50'000'000));
  joint_ = nothingInView(200'000'000);
  ASSERT_TRUE(joint_);
  EXPECT_EQ(joint_->keyframes.size(), 3U);
  EXPECT_FALSE(nothingInView(50'000'000)) << "once";
}

// The other marker is in the map by now: a bridge from the one to the other ties them anew.
TEST_F(GapMapperTest, ABridgeBetweenKnownMarkersTiesThem) {
  map_.addMarker(kNew, kSize_m);
  map_.place(kNew, T_w_new_);
  const Transform T_w_c = testing::lookAt({2.8, 0.0, 0.0}, {2.9, 1.0, 0.0});
  seen_ = testing::observeAll(camera_, T_w_c, {{kNew, T_w_new_}}, kSize_m, 0.05, &rng_);
  ASSERT_EQ(seen_.size(), 1U);
  const CarriedFrame frame{{9, 300'000'000}, seen_, T_w_c, covariance_, Twist::Zero(), kAnchor};
  const auto keyframe = mapper_.arrive(frame, map_);
  ASSERT_TRUE(keyframe);
  EXPECT_EQ(keyframe->sequence, 9U);
  EXPECT_NE(keyframe->find(kNew), nullptr);
  ASSERT_EQ(keyframe->links.size(), 1U);
  EXPECT_EQ(keyframe->links[0].marker, kAnchor);
  const auto alone = linkTo(kAnchor, T_w_anchor_, T_w_c, covariance_);
  EXPECT_TRUE(keyframe->links[0].covariance.isApprox(alone->covariance));

  CarriedFrame at_anchor = frame;
  at_anchor.anchor = kNew;
  EXPECT_FALSE(mapper_.arrive(at_anchor, map_)) << "what is in view is not carried to";
  at_anchor.anchor = -1;
  EXPECT_FALSE(mapper_.arrive(at_anchor, map_));
  map_.quarantine(kAnchor);
  EXPECT_FALSE(mapper_.arrive(frame, map_)) << "it is not there any more";
}

// It hardly showed from there how the marker is turned.
TEST_F(GapMapperTest, NearerViewsOfAMarkerThatHasJoinedAreTiedToTheAnchor) {
  ASSERT_NE(looksUntilDecided(), 0);
  map_.addMarker(kNew, kSize_m);
  map_.place(kNew, joint_->marker.T_w_m);
  const Transform T_w_last = joint_->keyframes.back().T_w_c;
  // As the filter has it, which takes the marker's place for known.
  const Matrix6d surer = 0.01 * covariance_;
  const auto goTo = [&](double share) {
    const Eigen::Vector3d to_last = T_w_last.p - T_w_new_.p;
    const Transform T_w_c = testing::lookAt(T_w_new_.p + share * to_last, T_w_new_.p);
    seen_ = testing::observeAll(camera_, T_w_c, {{kNew, T_w_new_}}, kSize_m, 0.05, &rng_);
    time_ns_ += kFramePeriodNs;
    return CarriedFrame{{++sequence_, time_ns_}, seen_, T_w_c, surer, Twist::Zero(), -1};
  };
  EXPECT_FALSE(mapper_.comeNearer(goTo(0.9), map_)) << "hardly nearer";
  const CarriedFrame nearer = goTo(0.6);
  const auto keyframe = mapper_.comeNearer(nearer, map_);
  ASSERT_TRUE(keyframe);
  EXPECT_NE(keyframe->find(kNew), nullptr);
  ASSERT_EQ(keyframe->links.size(), 1U);
  EXPECT_EQ(keyframe->links[0].marker, kAnchor);
  // Nothing is known better than when it joined, but for what all links of the stretch share.
  const Matrix6d F = rigidTransport(nearer.T_w_c.p - T_w_last.p);
  const double links = static_cast<double>(options_.views + options_.nearer_views);
  const auto then =
      linkTo(kAnchor, T_w_anchor_, nearer.T_w_c, links * F * covariance_ * F.transpose());
  EXPECT_TRUE(keyframe->links[0].covariance.isApprox(then->covariance, 1e-6));
  EXPECT_FALSE(mapper_.comeNearer(goTo(0.58), map_)) << "hardly nearer than that";
  EXPECT_TRUE(mapper_.comeNearer(goTo(0.38), map_));
  mapper_.endNearing();
  EXPECT_FALSE(mapper_.comeNearer(goTo(0.2), map_)) << "others are followed by now";
}

// What has given the map its marker is told of in its links already.
TEST_F(GapMapperTest, AStretchIsToldOfOnce) {
  ASSERT_NE(looksUntilDecided(), 0);
  map_.addMarker(kNew, kSize_m);
  map_.place(kNew, joint_->marker.T_w_m);
  const CarriedFrame frame{{20, time_ns_}, seen_,         joint_->keyframes.back().T_w_c,
                           covariance_,    Twist::Zero(), kAnchor};
  EXPECT_FALSE(mapper_.arrive(frame, map_));
  mapper_.leave();
  EXPECT_TRUE(mapper_.arrive(frame, map_)) << "the next one is another";
}

TEST_F(GapMapperTest, ACameraThatStandsStillDecidesNothing) {
  for (int i = 0; i < 30; ++i) EXPECT_FALSE(look(2.8)) << i;
}

TEST_F(GapMapperTest, ViewsOfAnEarlierStretchAreForgotten) {
  const int views = static_cast<int>(options_.views);
  for (int i = 0; i + 1 < views; ++i) ASSERT_FALSE(look(2.6 + 0.1 * i)) << i;
  EXPECT_FALSE(look(3.2, Vector6d::Zero(), 2'000'000'000)) << "after a pause";
  for (int i = 1; i + 1 < views; ++i) ASSERT_FALSE(look(3.2 - 0.1 * i)) << i;
  mapper_.leave();
  EXPECT_FALSE(look(3.3)) << "after markers gave the pose again";
}

TEST_F(GapMapperTest, AnAnchorThatIsNotThereAnyMoreLinksNothing) {
  anchor_ = -1;
  EXPECT_EQ(looksUntilDecided(), 0);
  anchor_ = kAnchor;
  map_.quarantine(kAnchor);
  EXPECT_EQ(looksUntilDecided(), 0);
}

TEST_F(GapMapperTest, WhatIsInTheMapOrDistrustedIsNotNew) {
  map_.addMarker(kNew, kSize_m);
  map_.ban(kNew);
  EXPECT_EQ(looksUntilDecided(), 0);
  map_.place(kNew, T_w_new_);
  EXPECT_EQ(looksUntilDecided(), 0);
}

// The camera's errors, drawn from their covariance, are what the link says of itself.
TEST_F(GapMapperTest, TheLinksCovarianceIsThatOfTheCarriedPose) {
  std::normal_distribution<double> normal;
  const Transform T_w_c = testing::lookAt({3.0, 0.0, 0.4}, {3.2, 1.4, 0.0});
  Matrix6d root = testing::disturbed(Transform{}, 0.3, &rng_).R.replicate<2, 2>() * 0.01;
  root.diagonal() << 0.01, 0.02, 0.015, 0.004, 0.006, 0.005;
  const Matrix6d covariance = root * root.transpose();
  const auto truth = T_w_c.inverse() * T_w_anchor_;
  double nees = 0.0;
  constexpr int kRuns = 2000;
  for (int i = 0; i < kRuns; ++i) {
    Vector6d z;
    for (int k = 0; k < 6; ++k) z[k] = 0.2 * normal(rng_);  // small: it is of first order
    const auto link = linkTo(kAnchor, T_w_anchor_, T_w_c.retract(root * z), covariance);
    ASSERT_TRUE(link);
    const Vector6d error = truth.localCoordinates(link->T_c_m) / 0.2;
    nees += error.dot(link->covariance.llt().solve(error)) / kRuns;
  }
  EXPECT_NEAR(nees, 6.0, 0.3);
  EXPECT_FALSE(linkTo(kAnchor, T_w_anchor_, T_w_c, Matrix6d::Zero())) << "no covariance";
}

}  // namespace
}  // namespace waymark::slam
