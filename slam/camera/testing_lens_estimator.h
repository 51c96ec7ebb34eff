// A lens estimator with a map of a few markers, as a lens that may be another one than the true one
// has seen them.
#pragma once

#include <random>

#include <gtest/gtest.h>

#include "slam/camera/lens_estimator.h"
#include "slam/camera/undistort_map.h"
#include "slam/testing/lens_scene.h"

namespace waymark::slam::testing {

inline const BundleOptions kBundle{.max_iterations = 30, .min_relative_decrease = 1e-8};
inline constexpr double kSigma_px = 0.05;

inline CameraModel shifted(const CameraModel& truth, double focal_share, double k1,
                           double centre_px) {
  IntrinsicVector v = truth.intrinsics();
  v.head<2>() *= 1.0 + focal_share;
  v[2] += centre_px;
  v[4] += k1;
  return CameraModel(truth.withIntrinsics(v));
}

class LensEstimatorTest : public ::testing::Test {
 protected:
  // The map as that lens has it.
  void see(const CameraModel& lens) {
    camera_ = lens;
    knowledge_ = {.given = lens};
    map_ = lensScene(truth_, kSigma_px, &rng_);
    undistortAgain(camera_, 0.0, &map_);
  }
  [[nodiscard]] LensEstimator estimator(const LensOptions& options = {}) {
    return {options, markers_, &camera_, &knowledge_};
  }
  int workUntilDone(double slice, LensEstimator* estimator) {
    int slices = 0;
    while (!estimator->isDone() && slices < 1'000'000) {
      estimator->work(slice, shutter_, map_, kBundle);
      ++slices;
    }
    return slices;
  }
  [[nodiscard]] double focalError() const {
    return camera_.calibration().fx / truth_.calibration().fx - 1.0;
  }

  std::mt19937 rng_{5};
  CameraModel truth_{testCalibration()};
  CameraModel camera_ = truth_;
  LensKnowledge knowledge_{.given = truth_};
  MarkerOptions markers_{.size_m = kLensSceneSize};
  RollingShutterEstimator shutter_{{.readout_s = 0.0}, markers_};
  Map map_;
};

}  // namespace waymark::slam::testing
