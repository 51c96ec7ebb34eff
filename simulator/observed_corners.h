// Corners as a detector without faults would find them, without rendering: projected from the
// truth, with noise of a known covariance. For what takes millions of frames.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "simulator/scene.h"
#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"

namespace waymark::simulator {

struct ObservationOptions {
  // Noise of a coordinate, pixels; each corner's covariance says the same. 0.1 is what images with
  // some noise and blur give.
  double sigma_px = 0.1;
  std::uint64_t seed = 1;
};

// The markers, seen from T_w_c, with the noise of that frame: the same for the same frame and seed.
// Sorted by id. A marker that faces away, or has a corner outside the image, is left out; what
// stands between is not looked at.
[[nodiscard]] std::vector<slam::MarkerDetection> observeCorners(const slam::CameraModel& camera,
                                                                const slam::Transform& T_w_c,
                                                                std::span<const Marker> markers,
                                                                std::uint64_t frame,
                                                                const ObservationOptions& options);

}  // namespace waymark::simulator
