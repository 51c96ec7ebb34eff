// What a camera would see of a picture from a given pose, before the lens blurs it.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/transform.h"
#include "slam/natural/pictures/natural_marker.h"
#include "slam/natural/pictures/pixel_rays.h"

namespace waymark::slam {

// Of a box of pixels of the image halved `level` times; row after row.
struct ExpectedPicture {
  int level = 0;
  int left = 0;  // of the box, pixels of that level
  int top = 0;
  int width = 0;
  int height = 0;
  std::vector<float> grey;                // beyond the print's edge as at it
  std::vector<Eigen::Vector2f> on_print;  // x right, y up, metres
  // From the print's edge inwards, pixels of that level; negative outside, and far below zero where
  // the pixel does not look at the print's plane.
  std::vector<float> inside_px;

  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(x);
  }
};

// Pixels of full size that the print covers in the image or beyond its border; 0 when part of it is
// not in front of the camera.
[[nodiscard]] double coveredArea_px(const NaturalMarker& marker, const Transform& T_c_p,
                                    const CameraModel& camera);

// The box holds all that the image shows of the print, and up to margin_px around it. Each pixel is
// the mean of sixteen places in it. Empty when there is nothing of the print in the image, or the
// camera sees its back.
[[nodiscard]] std::optional<ExpectedPicture> expectPicture(const NaturalMarker& marker,
                                                           const Transform& T_c_p, int level,
                                                           int margin_px, PixelRays* rays);

}  // namespace waymark::slam
