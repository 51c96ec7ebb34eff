// Where the truth puts a marker in an image.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>

#include <Eigen/Core>

#include "simulator/scene.h"
#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"

namespace waymark::simulator {

// Pixels (distorted, pixel centres), in the order of slam::markerCorners().
using ImageCorners = std::array<Eigen::Vector2d, 4>;

// Whether the image shows the corners is not asked, nor whether the marker faces the camera. Empty
// when a corner is behind the camera or outside the lens's range.
[[nodiscard]] inline std::optional<ImageCorners> projectMarker(const slam::CameraModel& camera,
                                                               const slam::Transform& T_c_m,
                                                               double size_m) {
  const auto corners = slam::markerCorners(size_m);
  ImageCorners pixels;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto pixel = camera.project(T_c_m * corners[k]);
    if (!pixel) return std::nullopt;
    pixels[k] = *pixel;
  }
  return pixels;
}

// The same, seen from T_w_c.
[[nodiscard]] inline std::optional<ImageCorners> projectMarker(const slam::CameraModel& camera,
                                                               const slam::Transform& T_w_c,
                                                               const Marker& marker) {
  return projectMarker(camera, T_w_c.inverse() * marker.T_w_m, marker.size_m);
}

// Pixels.
[[nodiscard]] inline double shortestSide(const ImageCorners& corners) {
  double shortest_px = (corners[0] - corners[3]).norm();
  for (std::size_t k = 1; k < 4; ++k) {
    shortest_px = std::min(shortest_px, (corners[k] - corners[k - 1]).norm());
  }
  return shortest_px;
}

}  // namespace waymark::simulator
