// Views of markers that are ambiguous one by one, for the tests of initialization.
#pragma once

#include <random>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "slam/initialization/one_frame.h"
#include "slam/testing/scene.h"

namespace waymark::slam::testing {

class AmbiguousMarkersTest : public ::testing::Test {
 protected:
  static constexpr double kSize = 0.1;
  static constexpr double kNoisePx = 0.15;

  AmbiguousMarkersTest() { options_.size_m = kSize; }

  static Transform view(double x_m, double y_m = 0.0) {
    return lookAt({x_m, y_m, 0.0}, {0.0, 3.0, 0.0});
  }

  std::vector<MarkerDetection> observe(const Transform& T_w_c) {
    return observeAll(camera_, T_w_c, markers_, kSize, kNoisePx, &rng_);
  }

  // The first pair of views, of many with other noise, that is ambiguous throughout.
  using Pair = std::pair<std::vector<MarkerDetection>, std::vector<MarkerDetection>>;
  Pair ambiguousPair(const Transform& T_w_0, const Transform& T_w_1) {
    const auto ambiguous = [&](const std::vector<MarkerDetection>& detections) {
      return initializeFromOneFrame(detections, options_, camera_.focalLength(), 3.0, {}).empty();
    };
    for (int i = 0; i < 1000; ++i) {
      Pair pair{observe(T_w_0), observe(T_w_1)};
      if (ambiguous(pair.first) && ambiguous(pair.second)) return pair;
    }
    ADD_FAILURE() << "the views are not ambiguous";
    return {};
  }

  std::mt19937 rng_{21};
  CameraModel camera_{testCalibration()};
  std::vector<SyntheticMarker> markers_ = frontalMarkers(&rng_);
  MarkerOptions options_;
};

}  // namespace waymark::slam::testing
