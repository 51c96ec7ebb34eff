// Frames of the pose integrator: a camera on the dolly before a textured wall. Tests only.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/camera_pose/pose_optimizer.h"
#include "slam/natural/filter/testing_textured_wall.h"
#include "slam/natural/pose_integrator.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam::testing {

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
    const auto seen = observe(camera_, truth_, 7, marker_, kSize_m, 0.1, &rng_);
    EXPECT_TRUE(seen);
    Transform believed = marker_;
    believed.p.x() += offset_m;
    const KnownMarker known = knownMarker(*seen, believed, kSize_m, Matrix6d::Identity() * 1e-8);
    Transform start = truth_;
    start.p.x() += offset_m;
    const auto solution = optimizer_.optimize({&known, 1}, start);
    EXPECT_TRUE(solution);
    PoseEstimate pose;
    pose.T_w_c = solution->T_w_c;
    pose.covariance = pose.view_covariance = solution->covariance;
    pose.source = PoseSource::kMarkers;
    const std::vector<KnownMarker> markers(static_cast<std::size_t>(markers_in_view_), known);
    if (integrator_->follow(time_ns, image, pose, beginning_, markers)) return {pose, true};
    return {integrator_->bridge(time_ns, image), false};
  }
  std::optional<PoseEstimate> bridge(std::int64_t time_ns, const ImageView& image) {
    const auto seen =
        unplaced_ ? observe(camera_, truth_, 8, *unplaced_, kSize_m, 0.1, &rng_) : std::nullopt;
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

  static constexpr double kRate_hz = 30.0;
  static constexpr double kSize_m = 0.2;
  CameraModel camera_{wideCalibration(320, 240)};
  TexturedWall wall_{3};
  Dolly dolly_;
  PoseOptimizer optimizer_{camera_.focalLength(), {}};
  Transform marker_ = markerFacing({0.0, -0.005, 0.1}, {0.0, -1.0, 0.1});
  std::optional<Transform> unplaced_;  // a marker that no map knows, in frames without the other
  std::mt19937 rng_{3};
  NaturalOptions options_;
  Counters counters_;
  std::optional<PoseIntegrator> integrator_;
  std::vector<std::uint8_t> pixels_;
  Transform truth_;
  int frame_ = 0;
  int markers_in_view_ = 1;
  Beginning beginning_ = Beginning::kAllowed;
};

}  // namespace waymark::slam::testing
