// A camera without a lens.
#pragma once

#include "slam/geometry/camera_model.h"

namespace waymark::bench {

// Pixels; the focal length is the width.
[[nodiscard]] inline slam::CameraModel pinhole(int width, int height) {
  slam::Calibration calibration;
  calibration.width = width;
  calibration.height = height;
  calibration.fx = calibration.fy = width;
  calibration.cx = 0.5 * (width - 1);
  calibration.cy = 0.5 * (height - 1);
  return slam::CameraModel(calibration);
}

}  // namespace waymark::bench
