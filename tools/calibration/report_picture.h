// A calibration as a picture: where its points were, and what is left of them.
#pragma once

#include <string>

#include <opencv2/core.hpp>

#include "tools/calibration/calibrator.h"

namespace waymark::calibration {

// Colour (BGR). Left: every point, and in red the cells of the picture without any. Right: every
// residual, enlarged as the heading says, with the mean and the root mean square of each region.
[[nodiscard]] cv::Mat drawReport(const CalibrationReport& report, const std::string& title);

}  // namespace waymark::calibration
