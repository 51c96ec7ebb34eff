// The four sides of a marker in an image, laid out from its corners.
#pragma once

#include <array>
#include <optional>

#include <Eigen/Core>

#include "slam/detection/edges/placed_image.h"
#include "slam/geometry/camera_model.h"

namespace waymark::slam {

// A straight line in normalized coordinates, between two corners.
struct MarkerSide {
  Eigen::Vector2d start, end;        // normalized
  Eigen::Vector2d along, outward;    // unit vectors, normalized coordinates
  double length = 0.0;               // normalized
  Eigen::Vector2d start_px, end_px;  // distorted
  double length_px = 0.0;
  // In the image, where a lens bends it: at share t of the way the sum of curve_px[k] t^k.
  std::array<Eigen::Vector2d, 5> curve_px;
  // What follows changes linearly from start to end.
  double scale_start = 0.0, scale_end = 0.0;          // pixels per normalized unit, across the side
  double thickness_start = 0.0, thickness_end = 0.0;  // of the black border, pixels
  // Sines of the angles to the sides before and after.
  double sine_start = 0.0, sine_end = 0.0;
  // Perspective along the side: see printCoordinate.
  double perspective = 1.0;
  int cells = 0;  // along the side, with the border

  // In the image at share t of the way, pixels.
  [[nodiscard]] Eigen::Vector2d pixelAt(double t) const {
    const auto& c = curve_px;
    return c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * c[4])));
  }
  // Where the image's t (0 .. 1) lies on the print, in cells from the start.
  [[nodiscard]] double printCoordinate(double t) const {
    return cells * t / (t + perspective * (1.0 - t));
  }
  // Curves it in the image: its middle goes outwards by so many pixels, its ends stay.
  void bend(double bow_px);
  // Everything in pixels, from the camera's to those of an image that may be reduced.
  void placeIn(const PlacedImage& placed);
};

// `corners`: normalized, clockwise in the image; side k runs from corner k to corner k + 1.
// `cells`: along a side of the print, with the border. Empty for a degenerate quad.
[[nodiscard]] std::optional<std::array<MarkerSide, 4>> layOutSides(
    const CameraModel& camera, const std::array<Eigen::Vector2d, 4>& corners, int cells);

}  // namespace waymark::slam
