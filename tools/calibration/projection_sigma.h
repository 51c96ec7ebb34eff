// How well a calibrated camera is known, seen in its picture instead of in its parameters.
#pragma once

#include <Eigen/Core>

#include "tools/calibration/camera_solver.h"

namespace waymark::calibration {

// Standard deviation with which the picture of a fixed direction is predicted, pixels, over a grid
// of pixels. What a rotation of the whole camera can do is taken out: the principal point alone may
// be poorly known without any harm.
struct ProjectionSigma {
  double mean_px = 0.0;
  double worst_px = 0.0;
  Eigen::Vector2d worst_at = Eigen::Vector2d::Zero();  // pixel
  // Share of the grid's pixels that the lens model can be inverted for: 0 to 1.
  double invertible = 1.0;
};

[[nodiscard]] ProjectionSigma projectionSigma(const Solution& solution);

}  // namespace waymark::calibration
