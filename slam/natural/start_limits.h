// Where in the image a marker or picture has to be for the filter to begin at it (seed 2, section
// 3.3). Features need a while in view of what they begin beside: the paper leaves out what is about
// to leave the image, 15 % of it at each border, what covers less than 10 % or more than 90 % of
// it. Here features begin as soon as a marker is seen and are worth what their covariance says, so
// that nothing of this is needed; it is for who wants to begin late and sure.
#pragma once

#include <span>
#include <string>

#include <Eigen/Core>

namespace waymark::slam {

struct StartLimits {
  // Of the image's width and height at each border, that no corner lies in; 0: corners may lie
  // beyond the image.
  double border = 0.0;
  // Of the image's area, by what the corners enclose.
  double min_area = 0.0;
  double max_area = 1.0;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// corners_px: in turn around the marker, pixels of an image of that size.
[[nodiscard]] bool isWithin(const StartLimits& limits, std::span<const Eigen::Vector2d> corners_px,
                            int width, int height);

}  // namespace waymark::slam
