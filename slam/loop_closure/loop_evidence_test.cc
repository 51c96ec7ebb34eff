#include "slam/loop_closure/loop_evidence.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.12;

// One marker, seen at a slant from so near that its better pose is the right one.
class LoopEvidenceTest : public ::testing::Test {
 protected:
  LoopEvidenceTest() {
    detection_ = testing::observe(camera_, truth_, 7, T_w_m_, kSize, 0.1, &rng_).value();
    known_ = testing::knownMarker(detection_, T_w_m_, kSize);
  }

  [[nodiscard]] LoopFrame evidence(const Transform& tracked) const {
    Keyframe frame;
    frame.T_w_c = tracked;
    return loopEvidence(std::move(frame), 0, {&known_, 1}, optimizer_, camera_.focalLength(), {});
  }
  // Where the other one of the square's two poses puts the camera.
  [[nodiscard]] Transform other() const {
    const auto square = estimateSquarePose(detection_, kSize, camera_.focalLength());
    return T_w_m_ * square.value().T_c_m[1].inverse();
  }

  std::mt19937 rng_{3};
  CameraModel camera_{testing::testCalibration()};
  PoseOptimizer optimizer_{camera_.focalLength()};
  Transform T_w_m_ = testing::markerFacing({0.0, 3.0, 0.0}, {1.5, 0.0, 0.0});
  Transform truth_ = testing::lookAt({0.0, 1.8, 0.1}, {0.0, 3.0, 0.0});
  MarkerDetection detection_;
  KnownMarker known_;
};

TEST_F(LoopEvidenceTest, TheBetterPoseIsEnoughWhereTheFrameWasTrackedNearIt) {
  Transform drifted = truth_;
  drifted.p += Eigen::Vector3d(0.1, -0.05, 0.02);
  const LoopFrame loop = evidence(drifted);
  ASSERT_EQ(loop.expected.size(), 1U);
  EXPECT_LT((loop.expected[0].p - truth_.p).norm(), 0.05);
  EXPECT_EQ(loop.loop_markers, std::vector{7});
  EXPECT_EQ(loop.frame.detections.size(), 1U);
}

// A marker that the map has from two views may be turned by more than tells the two apart.
TEST_F(LoopEvidenceTest, BothAreTriedWhereTheFrameWasTrackedNearTheOther) {
  ASSERT_GT((other().p - truth_.p).norm(), 0.3);
  const LoopFrame loop = evidence(other());
  ASSERT_EQ(loop.expected.size(), 2U);
  EXPECT_LT((loop.expected[0].p - truth_.p).norm(), 0.05);
  EXPECT_LT((loop.expected[1].p - other().p).norm(), 1e-9);
  EXPECT_EQ(loop.loop_markers, std::vector{7});
  EXPECT_EQ(loop.frame.detections.size(), 1U);
}

}  // namespace
}  // namespace waymark::slam
