#include "tests/bench/gap_follower.h"

#include <cmath>

#include <gtest/gtest.h>

namespace waymark::bench {
namespace {

using Eigen::Vector3d;
using slam::PoseSource;

constexpr double kRate_hz = 10.0;

slam::FrameResult poseAt(const Vector3d& p, PoseSource source, const Vector3d& sigma_m) {
  slam::PoseEstimate pose;
  pose.T_w_c.p = p;
  pose.covariance.setIdentity();
  pose.covariance *= 1e-6;
  pose.covariance.topLeftCorner<3, 3>() = sigma_m.cwiseAbs2().asDiagonal();
  pose.source = source;
  slam::FrameResult result;
  result.pose = pose;
  return result;
}

class GapFollowerTest : public ::testing::Test {
 protected:
  // The next frame; the scene's world is the map's.
  void add(const slam::FrameResult& result, const Vector3d& truth) {
    follower_.add(frame_++ / kRate_hz, result, {.p = truth}, {}, {});
  }
  // As many frames, 0.1 m farther each, from markers and right.
  void seeMarkers(int frames) {
    for (int i = 0; i < frames; ++i) {
      const Vector3d p = place();
      add(poseAt(p, PoseSource::kMarkers, Vector3d::Constant(0.003)), p);
    }
  }
  // The same carried, with this share too much of the way, and this standard deviation.
  void carry(int frames, double scale_error, double sigma_m) {
    const Vector3d start = place() - Vector3d(0.1, 0.0, 0.0);
    for (int i = 0; i < frames; ++i) {
      const Vector3d p = place();
      const Vector3d estimate = start + (1.0 + scale_error) * (p - start);
      add(poseAt(estimate, PoseSource::kNaturalFeatures, Vector3d::Constant(sigma_m)), p);
    }
  }
  [[nodiscard]] Vector3d place() const { return {0.1 * frame_, 0.0, 0.0}; }

  GapReport report_;
  GapFollower follower_{&report_};
  int frame_ = 0;
};

TEST_F(GapFollowerTest, AGapIsFromTheLastMarkerToTheNext) {
  seeMarkers(5);
  carry(20, 0.02, 0.05);
  EXPECT_TRUE(report_.gaps.empty()) << "nobody knows how long it is";
  seeMarkers(1);
  ASSERT_EQ(report_.gaps.size(), 1U);
  const Gap& gap = report_.gaps[0];
  EXPECT_NEAR(gap.begin_s, 0.4, 1e-12);
  EXPECT_NEAR(gap.end_s, 2.4, 1e-12);
  EXPECT_NEAR(gap.way_m, 2.0, 1e-12);
  EXPECT_EQ(gap.frames, 20);
  EXPECT_EQ(gap.posed, 20);
  ASSERT_TRUE(gap.last);
  EXPECT_NEAR(gap.last->error_m, 0.04, 1e-12);
  ASSERT_TRUE(gap.jump_m);
  EXPECT_NEAR(*gap.jump_m, 0.04, 1e-12) << "without the camera's own motion";
  ASSERT_TRUE(gap.into[0]);
  EXPECT_NEAR(gap.into[0]->error_m, 0.02, 3e-3);
  EXPECT_FALSE(gap.into[2]) << "5 s";
  EXPECT_EQ(report_.frames, 26);
  EXPECT_EQ(report_.posed, 26);
}

// The doubt about where the way began is in it, too.
TEST_F(GapFollowerTest, TheScaleAndWhatIsToldOfIt) {
  seeMarkers(5);
  carry(20, -0.02, 0.05);
  seeMarkers(1);
  ASSERT_EQ(report_.gaps.size(), 1U);
  ASSERT_TRUE(report_.gaps[0].last);
  const std::optional<Scale>& scale = report_.gaps[0].last->scale;
  ASSERT_TRUE(scale);
  EXPECT_NEAR(scale->error, -0.02, 1e-12);
  EXPECT_NEAR(scale->sigma, 0.05 / 2.0, 1e-12);
}

TEST_F(GapFollowerTest, AShortWayHasNoScale) {
  seeMarkers(5);
  const Vector3d p = place();
  for (int i = 0; i < 20; ++i) {
    add(poseAt(p, PoseSource::kNaturalFeatures, Vector3d::Constant(0.05)), p);
  }
  seeMarkers(1);
  ASSERT_EQ(report_.gaps.size(), 1U);
  ASSERT_TRUE(report_.gaps[0].last);
  EXPECT_FALSE(report_.gaps[0].last->scale);
}

TEST_F(GapFollowerTest, WhoIsLostHasNoEndAndNoJump) {
  seeMarkers(5);
  carry(20, 0.0, 0.05);
  for (int i = 0; i < 3; ++i) add({}, place());
  seeMarkers(1);
  ASSERT_EQ(report_.gaps.size(), 1U);
  EXPECT_EQ(report_.gaps[0].frames, 23);
  EXPECT_EQ(report_.gaps[0].posed, 20);
  EXPECT_FALSE(report_.gaps[0].last);
  EXPECT_FALSE(report_.gaps[0].jump_m);
  EXPECT_EQ(report_.posed, 26);
  EXPECT_EQ(report_.frames, 29);
}

// The doubt in another direction excuses nothing. A stretch lasts until the next frame, so that one
// of a single frame has a length.
TEST_F(GapFollowerTest, BeyondThreeSigmaIsAlongTheError) {
  const Vector3d sigma_m(0.01, 1.0, 1.0);
  const auto carriedWith = [&](double error_m) {
    const Vector3d p = place();
    add(poseAt(p + Vector3d(error_m, 0.0, 0.0), PoseSource::kNaturalFeatures, sigma_m), p);
  };
  seeMarkers(5);
  carriedWith(0.029);
  for (const double error_m : {0.031, 0.04, -0.05}) carriedWith(error_m);  // 0.6 s to 0.8 s
  carriedWith(0.02);
  carriedWith(0.04);
  add({}, place());
  ASSERT_EQ(report_.beyond_position.size(), 2U);
  EXPECT_NEAR(report_.beyond_position[0].begin_s, 0.6, 1e-12);
  EXPECT_NEAR(report_.beyond_position[0].end_s, 0.9, 1e-12);
  EXPECT_NEAR(report_.beyond_position[0].worst_m, 0.05, 1e-12);
  EXPECT_FALSE(report_.beyond_position[0].by_markers);
  EXPECT_NEAR(report_.beyond_position[1].begin_s, 1.0, 1e-12);
  EXPECT_NEAR(report_.beyond_position[1].end_s, 1.1, 1e-12);
  EXPECT_TRUE(report_.beyond.empty()) << "NEES is 25 at most";
  EXPECT_EQ(report_.beyond_3_sigma, 0);
}

TEST_F(GapFollowerTest, PosesFromMarkersMayBeBeyondThreeSigmaToo) {
  seeMarkers(5);
  for (int i = 0; i < 2; ++i) {
    const Vector3d p = place();
    add(poseAt(p + Vector3d(0.0, 0.03, 0.0), PoseSource::kMarkers, Vector3d::Constant(0.003)), p);
  }
  seeMarkers(1);
  ASSERT_EQ(report_.beyond.size(), 1U);
  EXPECT_TRUE(report_.beyond[0].by_markers);
  EXPECT_EQ(report_.beyond_3_sigma, 2);
  ASSERT_EQ(report_.beyond_position.size(), 1U);
  EXPECT_TRUE(report_.beyond_position[0].by_markers);
  EXPECT_NEAR(report_.beyond_position[0].end_s - report_.beyond_position[0].begin_s, 0.2, 1e-12);
}

TEST(FirstWay, IsHalfOfAWayThatComesBack) {
  simulator::Options options;
  options.scene = "dolly";
  options.duration_s = 2.0;
  const auto there = simulator::Simulation::create(options, simulator::Ending::kOfTheScene);
  ASSERT_TRUE(there) << there.error().message;
  EXPECT_EQ(firstWay(**there), (*there)->frameCount());
  const auto and_back = simulator::Simulation::create(options, simulator::Ending::kClosedLoop);
  ASSERT_TRUE(and_back) << and_back.error().message;
  EXPECT_EQ(firstWay(**and_back), (*and_back)->frameCount() / 2);
}

}  // namespace
}  // namespace waymark::bench
