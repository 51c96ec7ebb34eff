#include "slam/natural/filter/visual_filter.h"

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <gtest/gtest.h>

#include "slam/geometry/image_velocity.h"
#include "slam/natural/filter/testing_textured_wall.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

using testing::Dolly;
using testing::TexturedWall;

double threadCpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

// A camera on the dolly before the wall, with a marker at the beginning of it.
class WallRun {
 public:
  WallRun(int width, int height, double rate_hz, unsigned seed,
          const VisualFilterOptions& options = {})
      : camera_(testing::wideCalibration(width, height)),
        wall_(seed),
        rate_hz_(rate_hz),
        rng_(seed),
        filter_(options) {
    dolly_.seed = seed;
    marker_ = testing::markerFacing({0.0, -0.005, 0.1}, {0.0, -1.0, 0.1});
    Matrix6d rough = Matrix6d::Identity() * 4e-4;
    filter_.reinitialize(dolly_.at(0.0), rough);
  }

  // dark: the image is black; nothing is seen in it.
  VisualUpdate step(bool dark = false) { return stepAt(frame_ / rate_hz_, dark, true); }
  // on_the_dolly_s: where the dolly is, as the time at which it comes there.
  VisualUpdate stepAt(double on_the_dolly_s, bool dark, bool with_marker) {
    truth_ = dolly_.at(on_the_dolly_s);
    wall_.render(camera_, truth_, 2.0, static_cast<unsigned>(frame_), &pixels_);
    if (dark) std::fill(pixels_.begin(), pixels_.end(), std::uint8_t{5});
    std::vector<KnownMarker> known;
    const auto seen = testing::observe(camera_, truth_, 7, marker_, 0.2, 0.1, &rng_);
    marker_seen_ = seen.has_value() && !dark && with_marker;
    if (marker_seen_) {
      known.push_back(testing::knownMarker(*seen, marker_, 0.2, Matrix6d::Identity() * 1e-8));
    }
    const double before = threadCpu_ms();
    if (frame_ > 0) filter_.predict(1.0 / rate_hz_);
    const VisualUpdate update = filter_.update(
        {pixels_.data(), camera_.width(), camera_.height(), camera_.width()}, camera_, known);
    times_ms_.push_back(threadCpu_ms() - before);
    ++frame_;
    return update;
  }

  [[nodiscard]] Vector6d error() const { return filter_.pose().T_w_c.localCoordinates(truth_); }
  [[nodiscard]] double nees() const {
    return error().dot(filter_.pose().covariance.ldlt().solve(error()));
  }
  [[nodiscard]] double sigma_m() const {
    return std::sqrt(filter_.pose().covariance.topLeftCorner<3, 3>().trace());
  }
  [[nodiscard]] bool markerSeen() const { return marker_seen_; }
  [[nodiscard]] const Transform& truth() const { return truth_; }
  [[nodiscard]] VisualFilter& filter() { return filter_; }
  [[nodiscard]] std::vector<double>& times_ms() { return times_ms_; }

 private:
  CameraModel camera_;
  TexturedWall wall_;
  Dolly dolly_;
  double rate_hz_;
  std::mt19937 rng_;
  VisualFilter filter_;
  Transform marker_;
  Transform truth_;
  std::vector<std::uint8_t> pixels_;
  std::vector<double> times_ms_;
  int frame_ = 0;
  bool marker_seen_ = false;
};

struct Gap {
  int width, height;
  double rate_hz;
};

void printGap(const Gap& gap, unsigned seed, const WallRun& run, double length_m,
              std::vector<double> times_ms, double noise) {
  double mean = 0.0;
  for (const double t : times_ms) mean += t / static_cast<double>(times_ms.size());
  std::sort(times_ms.begin(), times_ms.end());
  const Vector6d e = run.error();
  std::printf(
      "%dx%d seed %u: %.1f mm (%.1f %.1f %.1f) and %.2f mrad after %.2f m, sigma %.1f mm, NEES "
      "%.1f, noise x%.2f; CPU mean %.2f, 99 %% %.2f, worst %.2f ms\n",
      gap.width, gap.height, seed, 1e3 * e.head<3>().norm(), 1e3 * e[0], 1e3 * e[1], 1e3 * e[2],
      1e3 * e.tail<3>().norm(), length_m, 1e3 * run.sigma_m(), run.nees(), noise, mean,
      times_ms[times_ms.size() * 99 / 100], times_ms.back());
}

class DollyGap : public ::testing::TestWithParam<Gap> {};

// From the last sight of one marker to where the next one would hang, 3.5 m further.
TEST_P(DollyGap, EndsNearTheTruth) {
  const Gap gap = GetParam();
  for (const unsigned seed : {1U, 2U, 3U}) {
    WallRun run(gap.width, gap.height, gap.rate_hz, seed);
    double last_seen = -10.0;
    const int frames = static_cast<int>(9.0 * gap.rate_hz);
    int starved = 0;
    for (int k = 0; k < frames; ++k) {
      const VisualUpdate update = run.step();
      if (run.markerSeen()) last_seen = run.truth().p.x();
      if (k > 10 && update.believed < 12) ++starved;
    }
    const double length_m = run.truth().p.x() - last_seen;
    printGap(gap, seed, run, length_m, run.times_ms(), run.filter().filter().noiseScale());
    EXPECT_GT(length_m, 1.5);
    EXPECT_LT(run.error().head<3>().norm(), 0.015 * length_m) << seed;
    EXPECT_LT(run.error().tail<3>().norm(), 0.01) << seed;
    EXPECT_LT(run.nees(), 6.0 * 4.0) << seed;  // 99.9 % of chi-square are below 22.5
    EXPECT_EQ(starved, 0) << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Cameras, DollyGap,
                         ::testing::Values(Gap{320, 240, 30.0}, Gap{640, 480, 60.0}),
                         [](const auto& test) {
                           return test.param.width == 320 ? "Small" : "Large";
                         });

TEST(VisualFilter, ASecondOfDarknessIsCrossed) {
  WallRun run(320, 240, 30.0, 4);
  for (int k = 0; k < 200; ++k) {
    const bool dark = k >= 110 && k < 140;
    const VisualUpdate update = run.step(dark);
    if (dark) {
      EXPECT_EQ(update.believed, 0);
      EXPECT_LT(run.nees(), 30.0) << k;
    }
  }
  std::printf("dark: %.1f mm, sigma %.1f mm, NEES %.1f\n", 1e3 * run.error().head<3>().norm(),
              1e3 * run.sigma_m(), run.nees());
  EXPECT_LT(run.nees(), 30.0);
  EXPECT_LT(run.error().head<3>().norm(), 0.1);
}

// Along the wall and back again, the marker at its beginning not looked at any more: what was left
// there is found again.
TEST(VisualFilter, PointsThatComeBackIntoViewBringThePoseBack) {
  struct Return {
    double error_m = 0.0;
    double nees = 0.0;
    int recalled = 0;
  };
  const auto thereAndBack = [](int remembered_views, unsigned seed) {
    constexpr double kRate_hz = 30.0;
    VisualFilterOptions options;
    options.features.remembered_views = remembered_views;
    WallRun run(320, 240, kRate_hz, seed, options);
    Return result;
    for (int k = 0; k < 9 * kRate_hz; ++k) {
      const double t = k / kRate_hz;
      // At the dolly's speed, a second to stop and one to go back.
      const double stopped_s = std::clamp(t - 4.0, 0.0, 2.0);
      const double at_s = std::min(t, 6.0) - 0.5 * stopped_s * stopped_s - std::max(0.0, t - 6.0);
      result.recalled += run.stepAt(at_s, false, t < 4.0).recalled;
    }
    result.error_m = run.error().head<3>().norm();
    result.nees = run.nees();
    return result;
  };
  double with_m = 0.0;
  double without_m = 0.0;
  for (const unsigned seed : {1U, 2U, 3U}) {
    const Return with = thereAndBack(VisualFilterOptions{}.features.remembered_views, seed);
    const Return without = thereAndBack(0, seed);
    std::printf("seed %u: %d points recalled, %.1f mm off, NEES %.1f; %.1f mm without, %.1f\n",
                seed, with.recalled, 1e3 * with.error_m, with.nees, 1e3 * without.error_m,
                without.nees);
    EXPECT_GE(with.recalled, 3) << seed;
    EXPECT_EQ(without.recalled, 0) << seed;
    EXPECT_LT(with.nees, 22.5) << seed;
    with_m += with.error_m / 3.0;
    without_m += without.error_m / 3.0;
  }
  EXPECT_LT(with_m, without_m);
}

TEST(VisualFilter, WithoutTextureItOnlyPredicts) {
  const CameraModel camera(testing::wideCalibration(320, 240));
  VisualFilter filter({});
  filter.reinitialize({}, Matrix6d::Identity() * 1e-6);
  const std::vector<std::uint8_t> grey(320 * 240, 128);
  for (int k = 0; k < 30; ++k) {
    filter.predict(1.0 / 30.0);
    const VisualUpdate update = filter.update({grey.data(), 320, 240, 320}, camera, {});
    EXPECT_EQ(update.added, 0);
    EXPECT_EQ(update.believed, 0);
  }
  EXPECT_GT(filter.pose().covariance(0, 0), 0.1);
  (void)filter.update({}, camera, {});  // no image at all
}

// A camera that goes slowly along the wall and turns to and fro. How far off it is in the end,
// metres, and its normalized error.
struct Shaken {
  double error_m = 0.0;
  double nees = 0.0;
};
Shaken shake(unsigned seed, double readout_s, double told_readout_s) {
  constexpr double kRate_hz = 30.0;
  const CameraModel camera(testing::wideCalibration(320, 240));
  TexturedWall wall(seed);
  VisualFilterOptions options;
  options.features.first_depth_m = 1.2;
  VisualFilter filter(options);
  filter.setReadout(told_readout_s);
  const auto poseAt = [](double t) {
    Transform T = testing::lookAt({0.0, -1.2, 0.1}, {0.0, 0.0, 0.1});
    T.p.x() += 0.1 * t;
    T.R = T.R * expSo3({0.04 * std::sin(5.0 * t), 0.08 * std::sin(6.0 * t), 0.0});
    return T;
  };
  std::vector<std::uint8_t> pixels;
  Matrix6d known = Matrix6d::Identity() * 1e-6;
  filter.reinitialize(poseAt(0.0), known);
  constexpr int kFrames = 90;
  for (int k = 0; k < kFrames; ++k) {
    const double t = k / kRate_hz;
    wall.renderRows(
        camera, [&](int row) { return poseAt(t + readout_s * rowTime(row, camera.height())); }, 2.0,
        static_cast<unsigned>(k), &pixels);
    if (k > 0) filter.predict(1.0 / kRate_hz);
    (void)filter.update({pixels.data(), 320, 240, 320}, camera, {});
  }
  const FilteredPose pose = filter.pose();
  const Vector6d error = pose.T_w_c.localCoordinates(poseAt((kFrames - 1) / kRate_hz));
  return {error.head<3>().norm(), error.dot(pose.covariance.ldlt().solve(error))};
}

// Nothing tells the scale here but the first depths, which are right.
TEST(VisualFilter, ARollingShutterThatItIsToldOfIsUndone) {
  constexpr unsigned kSeeds = 6;
  Shaken mean_told, mean_untold, mean_global;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Shaken told = shake(seed, 0.02, 0.02);
    const Shaken untold = shake(seed, 0.02, 0.0);
    const Shaken global = shake(seed, 0.0, 0.0);
    std::printf("seed %u: %.1f mm, NEES %.1f; untold %.1f mm, %.1f; without %.1f mm, %.1f\n", seed,
                1e3 * told.error_m, told.nees, 1e3 * untold.error_m, untold.nees,
                1e3 * global.error_m, global.nees);
    for (auto [mean, one] : {std::pair(&mean_told, told), std::pair(&mean_untold, untold),
                             std::pair(&mean_global, global)}) {
      mean->error_m += one.error_m / kSeeds;
      mean->nees += one.nees / kSeeds;
    }
  }
  EXPECT_LT(mean_told.error_m, 0.3 * mean_untold.error_m);
  EXPECT_LT(mean_told.error_m, 0.02);
  EXPECT_LT(mean_told.nees, 0.2 * mean_untold.nees);
  EXPECT_LT(mean_told.nees, 6.0);
  EXPECT_LT(mean_global.error_m, 0.01);
}

TEST(VisualFilter, TheSameTwiceIsTheSameToTheLastBit) {
  WallRun a(320, 240, 30.0, 5);
  WallRun b(320, 240, 30.0, 5);
  for (int k = 0; k < 60; ++k) {
    a.step();
    b.step();
  }
  EXPECT_EQ((a.filter().pose().T_w_c.p - b.filter().pose().T_w_c.p).norm(), 0.0);
  EXPECT_EQ((a.filter().pose().covariance - b.filter().pose().covariance).norm(), 0.0);
}

TEST(VisualFilterOptions, WhatCannotWorkIsTold) {
  EXPECT_EQ(VisualFilterOptions{}.invalidReason(), "");
  VisualFilterOptions options;
  options.patches.min_correlation = 1.5;
  EXPECT_NE(options.invalidReason(), "");
  options = {};
  options.features.blind_share = -1.0;
  EXPECT_NE(options.invalidReason(), "");
}

}  // namespace
}  // namespace waymark::slam
