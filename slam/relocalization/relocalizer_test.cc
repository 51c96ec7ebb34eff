#include "slam/relocalization/relocalizer.h"

#include <random>

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kSize = 0.12;

class RelocalizerTest : public ::testing::Test {
 protected:
  std::vector<KnownMarker> known(const std::vector<MarkerDetection>& detections) {
    return testing::knownFrom(detections, markers_, kSize);
  }

  std::mt19937 rng_{5};
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_ = testing::markerWall(2, 3, 0.6, &rng_);
  PoseOptimizer optimizer_{camera_.focalLength()};
  Transform truth_ = testing::lookAt({0.3, -1.5, 0.1}, {0.0, 3.0, 0.0});
};

TEST_F(RelocalizerTest, FindsThePoseFromAmbiguousMarkers) {
  const auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.3, &rng_);
  ASSERT_GE(detections.size(), 3U);
  const auto found = relocalize(known(detections), optimizer_, camera_.focalLength());
  ASSERT_TRUE(found);
  EXPECT_LT((found->T_w_c.p - truth_.p).norm(), 0.15);
  EXPECT_LT(rotationDistance(found->T_w_c.R, truth_.R), 0.05);
}

TEST_F(RelocalizerTest, RejectsOneAmbiguousMarkerAlone) {
  auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.3, &rng_);
  detections.resize(1);
  EXPECT_FALSE(relocalize(known(detections), optimizer_, camera_.focalLength()));
}

TEST_F(RelocalizerTest, TakesOneUnambiguousMarker) {
  const Transform near = testing::lookAt({0.9, 2.2, 0.1}, markers_[1].T_w_m.p);
  auto detections = testing::observeAll(camera_, near, markers_, kSize, 0.05, &rng_);
  std::erase_if(detections, [](const MarkerDetection& d) { return d.id != 1; });
  ASSERT_EQ(detections.size(), 1U);
  const auto found = relocalize(known(detections), optimizer_, camera_.focalLength());
  ASSERT_TRUE(found);
  EXPECT_LT((found->T_w_c.p - near.p).norm(), 0.02);
}

TEST_F(RelocalizerTest, EnoughOfWhatIsSeenHasToAgree) {
  auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.05, &rng_);
  ASSERT_GE(detections.size(), 4U);
  markers_[static_cast<std::size_t>(detections[1].id)].T_w_m.p.x() += 0.05;
  const auto found = relocalize(known(detections), optimizer_, camera_.focalLength());
  ASSERT_TRUE(found);
  EXPECT_FALSE(found->inlier[1]);
  RelocalizerOptions all;
  all.min_inlier_share = 1.0;
  EXPECT_FALSE(relocalize(known(detections), optimizer_, camera_.focalLength(), all));
}

// Two good markers are enough, unless their errors are cut off before they can tell a pose from its
// rival.
TEST_F(RelocalizerTest, ACutThatIsTooLowLeavesRivals) {
  RelocalizerOptions low;
  low.max_marker_chi2 = 0.1;
  int found = 0;
  int found_with_low = 0;
  for (int i = 0; i < 20; ++i) {
    markers_ = testing::markerWall(2, 3, 0.6, &rng_);
    auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.05, &rng_);
    ASSERT_GE(detections.size(), 2U);
    detections.resize(2);
    const auto two = known(detections);
    if (relocalize(two, optimizer_, camera_.focalLength())) ++found;
    if (relocalize(two, optimizer_, camera_.focalLength(), low)) ++found_with_low;
  }
  EXPECT_EQ(found, 20);
  EXPECT_LT(found_with_low, 18);
}

TEST_F(RelocalizerTest, RejectsAMapThatDoesNotFit) {
  auto detections = testing::observeAll(camera_, truth_, markers_, kSize, 0.05, &rng_);
  ASSERT_GE(detections.size(), 4U);
  // Every marker hangs somewhere else than the map says.
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  for (auto& marker : markers_) marker.T_w_m.p += Eigen::Vector3d(u(rng_), u(rng_), u(rng_));
  const auto found = relocalize(known(detections), optimizer_, camera_.focalLength());
  EXPECT_TRUE(!found || found->rms_px > 3.0);
  EXPECT_FALSE(relocalize({}, optimizer_, camera_.focalLength()));
}

}  // namespace
}  // namespace waymark::slam
