#include "slam/final_smoother.h"

#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/covariance/marginals.h"
#include "slam/geometry/turned_covariance.h"

namespace waymark::slam {
namespace {

// A camera that goes along a wall and looks about; live, its pose drifts through the gap, and jumps
// back at its end.
class FinalSmootherTest : public ::testing::Test {
 protected:
  static constexpr int kFrames = 120;
  static constexpr int kBegin = 30;  // of the gap
  static constexpr int kEnd = 90;
  static constexpr double kRate_hz = 30.0;

  [[nodiscard]] static Transform truthAt(int i) {
    const double t = i / kRate_hz;
    return {expSo3({0.1 * std::sin(t), 0.3 * std::sin(0.7 * t), 0.0}),
            {0.5 * t, 0.05 * std::sin(2.0 * t), 0.02 * t}};
  }
  Vector6d draw(const Matrix6d& covariance) {
    std::normal_distribution<double> normal;
    Vector6d v;
    for (double& x : v) x = normal(rng_);
    return covariance.llt().matrixL() * v;
  }

  void simulate(unsigned seed) {
    rng_.seed(seed);
    frames_.assign(kFrames, {});
    placed_.assign(kFrames, std::nullopt);
    Transform T_w_c;
    Matrix6d P = markers_;
    for (int i = 0; i < kFrames; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const bool seen = i < kBegin || i >= kEnd;
      if (i == 0 || i == kEnd) {
        T_w_c = truthAt(i).retract(draw(markers_));
        P = markers_;
      } else {
        const Matrix6d F = rigidTransport(truthAt(i).p - truthAt(i - 1).p);
        T_w_c = (T_w_c * (truthAt(i - 1).inverse() * truthAt(i))).retract(draw(drift_));
        P = F * P * F.transpose() + drift_;
      }
      PoseEstimate live;
      live.T_w_c = T_w_c;
      live.covariance = live.view_covariance = P;
      live.source = seen ? PoseSource::kMarkers : PoseSource::kNaturalFeatures;
      live.features_used = 30;
      const Transform step = truthAt(i).inverse() * truthAt(i + 1);
      live.twist << step.p * kRate_hz, logSo3(step.R) * kRate_hz;
      frames_[at] = {std::llround(1e9 * i / kRate_hz), live, {}};
      if (!seen) continue;
      PoseEstimate placed;
      placed.T_w_c = T_world_ * truthAt(i).retract(draw(markers_));
      placed.view_covariance = turnedCovariance(T_world_.R, markers_);
      placed_[at] = placed;
    }
  }
  [[nodiscard]] Vector6d errorAt(const Transform& T_w_c, int i) const {
    return T_w_c.localCoordinates(T_world_ * truthAt(i));
  }

  // Of a frame's motion, and of a frame's markers: metres and radians.
  const Matrix6d drift_ = independentCovariance(0.0005, 0.0002);
  const Matrix6d markers_ = independentCovariance(0.002, 0.001);

  std::mt19937 rng_;
  Transform T_world_;  // the final map's coordinates of the live ones
  std::vector<LiveFrame> frames_;
  std::vector<std::optional<PoseEstimate>> placed_;
};

// The final map lies elsewhere than the live one did.
TEST_F(FinalSmootherTest, IsAsFarOffAsItsCovarianceSays) {
  T_world_ = {expSo3({0.2, -0.4, 1.0}), {3.0, -1.0, 2.0}};
  constexpr int kRuns = 100;
  double nees = 0.0;
  double off_m = 0.0;
  double live_m = 0.0;
  int count = 0;
  for (int run = 0; run < kRuns; ++run) {
    simulate(static_cast<unsigned>(run));
    const auto smoothed = smoothTrajectory(frames_, placed_);
    for (int i = kBegin; i < kEnd; i += 15) {
      const auto at = static_cast<std::size_t>(i);
      ASSERT_TRUE(smoothed[at]);
      const Vector6d e = errorAt(smoothed[at]->T_w_c, i);
      nees += e.dot(smoothed[at]->covariance.ldlt().solve(e));
      ++count;
    }
    const auto last = static_cast<std::size_t>(kEnd - 1);
    off_m += errorAt(smoothed[last]->T_w_c, kEnd - 1).head<3>().norm() / kRuns;
    live_m += (frames_[last].pose->T_w_c.p - truthAt(kEnd - 1).p).norm() / kRuns;
  }
  nees /= count;
  // Frames' markers are taken to be off in common for 0.2 s, which they are not here.
  EXPECT_GT(nees, 3.0);
  EXPECT_LT(nees, 7.0);
  EXPECT_LT(off_m, 0.4 * live_m);
}

TEST_F(FinalSmootherTest, WithoutAnEndWhatIsNotKnownGrows) {
  simulate(1);
  placed_.resize(kEnd);
  frames_.resize(kEnd);
  const auto smoothed = smoothTrajectory(frames_, placed_);
  const auto sigma = [&](int i) {
    return std::sqrt(
        smoothed[static_cast<std::size_t>(i)]->covariance.topLeftCorner<3, 3>().trace());
  };
  EXPECT_GT(sigma(kEnd - 1), 2.0 * sigma(kBegin));
  EXPECT_GT(sigma(kEnd - 1), sigma((kBegin + kEnd) / 2));
}

// Nothing goes across a frame that was lost live, and a stretch that no map places stays empty.
TEST_F(FinalSmootherTest, AStretchIsByItself) {
  simulate(1);
  frames_[60].pose.reset();
  for (int i = kEnd; i < kFrames; ++i) placed_[static_cast<std::size_t>(i)].reset();
  const auto smoothed = smoothTrajectory(frames_, placed_);
  EXPECT_TRUE(smoothed[59]);
  for (int i = 60; i < kFrames; ++i) EXPECT_FALSE(smoothed[static_cast<std::size_t>(i)]) << i;
}

}  // namespace
}  // namespace waymark::slam
