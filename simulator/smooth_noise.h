// Smooth noise over an image: clouds, stains, uneven light.
#pragma once

#include <opencv2/core.hpp>

#include "simulator/random.h"

namespace waymark::simulator {

// Random values `wavelength` pixels apart, even in -amplitude .. amplitude, interpolated by cubics
// (CV_32F).
[[nodiscard]] cv::Mat smoothNoise(const cv::Size& size, double wavelength, double amplitude,
                                  Random* random);

// All octaves from `longest` down to 3 pixels, each with `fall` of the one before (CV_32F).
[[nodiscard]] cv::Mat clouds(const cv::Size& size, double longest, double amplitude, double fall,
                             Random* random);

}  // namespace waymark::simulator
