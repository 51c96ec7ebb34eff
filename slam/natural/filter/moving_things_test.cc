// Things that move in view: what the filter takes for the room must be the room.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <numbers>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/natural/filter/testing_textured_wall.h"
#include "slam/natural/filter/visual_filter.h"

namespace waymark::slam {
namespace {

using testing::TexturedWall;

constexpr int kWidth = 320;
constexpr int kHeight = 240;
constexpr double kRate_hz = 30.0;
constexpr double kNearEnough = 9.0 * 6.0;  // three standard deviations in six dimensions

// A wall, and boards before it that somebody pushes along it and back: from `begin_s` on, 0.6 m in
// five seconds, beginning and ending gently.
class WallWithBoards {
 public:
  WallWithBoards(unsigned seed, double begin_s)
      : camera_(testing::wideCalibration(kWidth, kHeight)),
        wall_(seed),
        boards_(seed + 100),
        begin_s_(begin_s) {
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        rays_.push_back(camera_.undistort({x, y}).value_or(Eigen::Vector2d::Zero()).homogeneous());
      }
    }
  }

  [[nodiscard]] const CameraModel& camera() const { return camera_; }

  void render(const Transform& T_w_c, double t, std::vector<std::uint8_t>* pixels) {
    const double pushed_m = pushedAt(t);
    Transform T_boards_c = T_w_c;
    T_boards_c.p.x() -= pushed_m;
    const auto frame = static_cast<unsigned>(t * kRate_hz);
    wall_.render(camera_, T_w_c, 2.0, frame, pixels);
    boards_.render(camera_, T_boards_c, 2.0, frame + 5000, &of_boards_);
    for (std::size_t i = 0; i < pixels->size(); ++i) {
      const Eigen::Vector3d ray = T_w_c.R * rays_[i];
      const double x = T_w_c.p.x() - T_w_c.p.y() * ray.x() / ray.y() - pushed_m;
      if (ray.y() > 0.02 && isBoard(x)) (*pixels)[i] = of_boards_[i];
    }
  }

 private:
  [[nodiscard]] double pushedAt(double t) const {
    const double since_s = std::clamp(t - begin_s_, 0.0, 5.0);
    return 0.3 * (1.0 - std::cos(2.0 * std::numbers::pi * since_s / 5.0));
  }
  [[nodiscard]] static bool isBoard(double x) {
    return (x > -0.9 && x < -0.5) || (x > 0.3 && x < 0.7);
  }

  CameraModel camera_;
  TexturedWall wall_;
  TexturedWall boards_;
  double begin_s_;
  std::vector<Eigen::Vector3d> rays_;
  std::vector<std::uint8_t> of_boards_;
};

// Slowly along the wall, and about.
Transform walk(double t) {
  const Eigen::Vector3d eye(-0.9 + 0.15 * t, -1.5 + 0.1 * std::sin(0.7 * t), 0.05 * std::sin(t));
  return testing::lookAt(eye, eye + Eigen::Vector3d(0.3 * std::sin(0.5 * t), 1.0, 0.0));
}

struct Followed {
  double worst_m = 0.0;
  int beyond = 0;  // frames whose error is more than its covariance allows
  int wary = 0;    // frames
};

Followed follow(unsigned seed, double begin_s, const VisualFilterOptions& options) {
  WallWithBoards wall(seed, begin_s);
  VisualFilter filter(options);
  Matrix6d known = Matrix6d::Identity() * 1e-6;
  filter.reinitialize(walk(0.0), known);
  const Transform marker = testing::markerFacing({-0.3, -0.005, 0.1}, {-0.3, -1.0, 0.1});
  std::mt19937 rng(seed);
  std::vector<std::uint8_t> pixels;
  Followed result;
  for (int k = 0; k < static_cast<int>(8.0 * kRate_hz); ++k) {
    const double t = k / kRate_hz;
    wall.render(walk(t), t, &pixels);
    // For a second there is a marker, which tells the depths.
    std::vector<KnownMarker> markers;
    const auto seen = testing::observe(wall.camera(), walk(t), 7, marker, 0.3, 0.1, &rng);
    if (t < 1.0 && seen) {
      markers.push_back(testing::knownMarker(*seen, marker, 0.3, Matrix6d::Identity() * 1e-8));
    }
    if (k > 0) filter.predict(1.0 / kRate_hz);
    const VisualUpdate update =
        filter.update({pixels.data(), kWidth, kHeight, kWidth}, wall.camera(), markers);
    const Vector6d e = filter.pose().T_w_c.localCoordinates(walk(t));
    result.worst_m = std::max(result.worst_m, e.head<3>().norm());
    result.wary += update.wary ? 1 : 0;
    result.beyond += e.dot(filter.pose().covariance.ldlt().solve(e)) > kNearEnough ? 1 : 0;
  }
  return result;
}

TEST(MovingThings, WhatBeginsToMoveTakesNobodyAlong) {
  VisualFilterOptions trusting;
  trusting.features.wary_s = 0.0;
  int beyond = 0;
  int beyond_when_trusting = 0;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    const Followed result = follow(seed, 2.0, {});
    const Followed without = follow(seed, 2.0, trusting);
    std::printf("seed %u: %.0f mm at worst, %d frames beyond, %d wary; %.0f mm, %d without\n", seed,
                1e3 * result.worst_m, result.beyond, result.wary, 1e3 * without.worst_m,
                without.beyond);
    EXPECT_GT(result.wary, 30) << seed;
    EXPECT_EQ(without.wary, 0) << seed;
    beyond += result.beyond;
    beyond_when_trusting += without.beyond;
  }
  EXPECT_LE(beyond, 6) << "a fifth of a second of 48";
  EXPECT_GT(beyond_when_trusting, 30) << "or nothing here would need any of it";
}

TEST(MovingThings, WhereNothingMovesItTrusts) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const Followed result = follow(seed, 100.0, {});
    EXPECT_LT(result.wary, 10) << seed;
    EXPECT_EQ(result.beyond, 0) << seed;
  }
}

}  // namespace
}  // namespace waymark::slam
