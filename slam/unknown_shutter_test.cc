// The first second of a rolling shutter that nobody has told of: what it does to the corners is not
// known yet, and the poses say so.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/slam.h"
#include "slam/testing/rolling_views.h"

namespace waymark::slam {
namespace {

constexpr double kPrint_m = 0.12;
constexpr double kReadout_s = 0.02;
constexpr double kFrame_s = 1.0 / 30.0;
constexpr int kFrames = 30;

// A camera in a hand, in front of a wall.
class Handheld {
 public:
  Handheld(unsigned seed, const RollingShutterOptions& shutter) : rng_(seed) {
    phase_ = std::uniform_real_distribution(0.0, 6.0)(rng_);
    markers_ = testing::markerWall(3, 5, 0.5, &rng_);
    Options options;
    options.markers.size_m = kPrint_m;
    options.shutter = shutter;
    slam_.emplace(camera_, *Dictionary::byName("APRILTAG_36h11"), options);
  }

  // NEES of each of a second's poses, in the world of the first keyframe.
  std::vector<double> look() {
    std::vector<double> nees;
    std::optional<Transform> T_w_scene;
    for (int i = 0; i < kFrames; ++i) {
      const auto result = slam_->process(frame(i));
      if (!result.pose) continue;
      if (!T_w_scene) {
        const Keyframe& first = slam_->map().keyframes().begin()->second;
        T_w_scene = first.T_w_c * poseAt(static_cast<double>(first.sequence)).inverse();
        continue;
      }
      const Vector6d error = result.pose->T_w_c.localCoordinates(*T_w_scene * poseAt(i));
      nees.push_back(error.dot(Matrix6d(result.pose->covariance).ldlt().solve(error)));
    }
    return nees;
  }
  [[nodiscard]] const Slam& slam() const { return *slam_; }

 private:
  [[nodiscard]] Transform poseAt(double frame) const {
    const double s = phase_ + 1.5 * kFrame_s * frame;
    return testing::lookAt({0.5 * std::sin(s), 0.3 * std::sin(0.7 * s), 0.2 * std::cos(1.3 * s)},
                           {0.7 * std::sin(0.9 * s), 3.0, 0.3 * std::cos(0.8 * s)});
  }
  FrameInput frame(int i) {
    constexpr double kStep = 0.05;  // frames
    const Transform T_w_c = poseAt(i);
    const Transform T_c_next = T_w_c.inverse() * poseAt(i + kStep);
    Twist twist;
    twist << T_c_next.p, logSo3(T_c_next.R);
    twist /= kStep * kFrame_s;
    seen_.clear();
    for (const auto& marker : markers_) {
      const auto seen =
          testing::observeRolling(camera_, T_w_c, twist, marker, kPrint_m, kReadout_s, 0.1, &rng_);
      if (seen) seen_.push_back(*seen);
    }
    FrameInput input;
    input.time = {static_cast<std::uint64_t>(i), static_cast<std::int64_t>(1e9 * kFrame_s * i)};
    input.detections = seen_;
    return input;
  }

  std::mt19937 rng_;
  double phase_ = 0.0;
  CameraModel camera_{testing::testCalibration()};
  std::vector<testing::SyntheticMarker> markers_;
  std::vector<MarkerDetection> seen_;
  std::optional<Slam> slam_;
};

double meanOver(const RollingShutterOptions& shutter, std::uint64_t* quarantined) {
  double sum = 0.0;
  int count = 0;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    Handheld hand(seed, shutter);
    for (const double nees : hand.look()) {
      sum += nees;
      ++count;
    }
    *quarantined += hand.slam().counters().quarantined_markers;
  }
  return sum / count;
}

// Never overconfident by more than 1.5 as standard deviations: NEES of six dimensions.
TEST(UnknownShutterTest, TheFirstPosesKnowThatTheyDoNotKnowIt) {
  std::uint64_t quarantined = 0;
  const double mean = meanOver({}, &quarantined);
  std::uint64_t quarantined_without = 0;
  const double without = meanOver({.unknown_s = 0.0}, &quarantined_without);
  std::printf("NEES %.1f; taken for a global shutter %.1f, %d markers in quarantine\n", mean,
              without, static_cast<int>(quarantined_without));
  EXPECT_LT(mean, 1.5 * 1.5 * 6.0);
  EXPECT_GT(mean, 0.5);
  EXPECT_GT(without, 3.0 * mean);
  EXPECT_EQ(quarantined, 0u) << "no marker has moved";
}

}  // namespace
}  // namespace waymark::slam
