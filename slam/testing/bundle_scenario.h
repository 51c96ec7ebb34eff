// A bundle adjustment whose answer is known: markers on a wall, cameras along it.
#pragma once

#include <deque>
#include <random>
#include <utility>
#include <vector>

#include "slam/optimization/bundle_problem.h"
#include "slam/testing/scene.h"

namespace waymark::slam::testing {

// Every start pose is a little off; the first camera is right and fixed. Not copied nor moved: the
// problem points into it.
struct BundleScenario {
  static constexpr double kSizeM = 0.12;

  BundleScenario(unsigned seed, double sigma_px, int camera_count = 10, int rows = 3,
                 int columns = 4)
      : BundleScenario(seed, sigma_px, alongTheWall(camera_count), rows, columns) {}
  BundleScenario(unsigned seed, double sigma_px, std::vector<Transform> cameras, int rows,
                 int columns)
      : rng(seed), true_cameras(std::move(cameras)) {
    const auto markers = markerWall(rows, columns, 0.5, &rng);
    for (const auto& marker : markers) {
      true_markers.push_back(marker.T_w_m);
      problem.markers.push_back({disturbed(marker.T_w_m, 0.02, &rng), false});
      problem.marker_sizes_m.push_back(kSizeM);
    }
    for (const Transform& T_w_c : true_cameras) {
      const int c = static_cast<int>(problem.cameras.size());
      problem.cameras.push_back({c == 0 ? T_w_c : disturbed(T_w_c, 0.02, &rng), c == 0});
      for (const auto& marker : markers) {
        const auto seen = observe(camera, T_w_c, marker.id, marker.T_w_m, kSizeM, sigma_px, &rng);
        if (!seen) continue;
        detections.push_back(*seen);
        problem.observations.push_back({c, marker.id, &detections.back()});
      }
    }
  }
  BundleScenario(const BundleScenario&) = delete;
  BundleScenario& operator=(const BundleScenario&) = delete;

  // The lens is unknown, and expected where `off` says. The detections' normalized corners are what
  // that wrong lens makes of the pixels.
  void disturbLens(const IntrinsicVector& off, const IntrinsicVector& sigma) {
    const IntrinsicVector expected = camera.intrinsics() + off;
    const CameraModel wrong(camera.withIntrinsics(expected));
    for (MarkerDetection& detection : detections) {
      for (std::size_t k = 0; k < 4; ++k) {
        detection.normalized[k] = *wrong.undistort(detection.pixels[k]);
      }
    }
    problem.lens = {wrong, wrong, expected, sigma.cwiseAbs2().asDiagonal()};
  }

  // A surveyed pose of the marker, `off` from the truth.
  void anchor(int marker, const Vector6d& off, double sigma_m, double sigma_rad) {
    Vector6d information;
    information << Eigen::Vector3d::Constant(1.0 / (sigma_m * sigma_m)),
        Eigen::Vector3d::Constant(1.0 / (sigma_rad * sigma_rad));
    const Transform& truth = true_markers[static_cast<std::size_t>(marker)];
    problem.priors.push_back({marker, truth.retract(off), information.asDiagonal()});
  }

  static std::vector<Transform> alongTheWall(int count) {
    std::vector<Transform> cameras;
    for (int c = 0; c < count; ++c) {
      cameras.push_back(
          lookAt({0.25 * c - 1.1, 0.4 * (c % 3), 0.2 * (c % 2)}, {0.1 * c - 0.5, 3.0, 0.0}));
    }
    return cameras;
  }

  std::mt19937 rng;
  CameraModel camera{testCalibration()};
  std::vector<Transform> true_cameras, true_markers;
  std::deque<MarkerDetection> detections;
  BundleProblem problem;
};

// fx fy cx cy k1 k2 p1 p2 k3: a calibration gone stale, and how well such a one is known.
inline IntrinsicVector staleLens() {
  return (IntrinsicVector() << 6.0, 5.0, -4.0, 3.0, 0.02, -0.02, 4e-4, -3e-4, 0.0).finished();
}
inline IntrinsicVector lensSigma() {
  return (IntrinsicVector() << 8.0, 8.0, 5.0, 5.0, 0.03, 0.03, 1e-3, 1e-3, 0.0).finished();
}

}  // namespace waymark::slam::testing
