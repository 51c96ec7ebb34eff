// Full-frame search for dark, convex quadrilaterals: the first, rough stage of detection.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "base/image_view.h"

namespace waymark::slam {

struct QuadScannerOptions {
  // Side of the window of the adaptive threshold, pixels, odd. Larger finds bigger blurred borders,
  // smaller separates close markers.
  int threshold_window_px = 15;
  // A pixel is dark below mean * (1 - share) - offset of its window: the share goes with the light
  // on the scene, the offset (grey levels) with the sensor's noise. Larger values separate squares
  // that touch and are deaf to faint prints.
  double threshold_share = 0.07;
  double threshold_offset = 4.0;
  // Shortest side of a candidate, pixels.
  double min_side_px = 7.0;
  // Largest deviation of the outline from the quad, as a share of the perimeter.
  double outline_tolerance = 0.03;
  // Candidates with a corner nearer than this to the image border are clipped markers, pixels.
  double border_margin_px = 2.0;
};

// Corners in pixels (pixel centres), clockwise in the image, good to about a pixel.
using Quad = std::array<Eigen::Vector2d, 4>;

class QuadScanner {
 public:
  explicit QuadScanner(const QuadScannerOptions& options = {});

  // The result is valid until the next call.
  const std::vector<Quad>& scan(const ImageView& image);

 private:
  void collectQuads();

  QuadScannerOptions options_;
  std::array<std::uint8_t, 256> dark_below_;  // by the window's mean
  cv::Mat mean_;
  cv::Mat light_;
  std::vector<std::vector<cv::Point>> outlines_;
  std::vector<cv::Vec4i> hierarchy_;
  std::vector<cv::Point> polygon_;
  std::vector<Quad> quads_;
};

}  // namespace waymark::slam
