// What a moving camera with a rolling shutter sees, for the tests.
#pragma once

#include <optional>
#include <random>

#include "slam/camera/rolling_shutter.h"
#include "slam/geometry/moved_on.h"
#include "slam/geometry/twist.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam::testing {

// The marker as a camera that is at T_w_c in mid-exposure sees it: each corner at the time its row
// is read. The rows are found by going there and looking.
inline std::optional<MarkerDetection> observeRolling(const CameraModel& camera,
                                                     const Transform& T_w_c, const Twist& twist,
                                                     const SyntheticMarker& marker, double size_m,
                                                     double readout_s, double sigma_px,
                                                     std::mt19937* rng) {
  auto seen = observe(camera, T_w_c, marker.id, marker.T_w_m, size_m, 0.0, rng);
  if (!seen) return std::nullopt;
  std::normal_distribution<double> noise(0.0, 1.0);
  const auto corners = markerCorners(size_m);
  for (std::size_t k = 0; k < 4; ++k) {
    for (int i = 0; i < 10; ++i) {
      const double late_s = readout_s * rowTime(seen->pixels[k].y(), camera.height());
      const Transform T_w_late = movedOn(T_w_c, twist, late_s);
      const auto pixel = camera.project(T_w_late.inverse() * (marker.T_w_m * corners[k]));
      if (!pixel) return std::nullopt;
      seen->pixels[k] = *pixel;
    }
    seen->pixels[k] += sigma_px * Eigen::Vector2d(noise(*rng), noise(*rng));
    const auto normalized = camera.undistort(seen->pixels[k]);
    if (!normalized) return std::nullopt;
    seen->normalized[k] = *normalized;
  }
  return seen;
}

}  // namespace waymark::slam::testing
