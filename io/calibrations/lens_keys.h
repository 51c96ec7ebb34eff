// What the calibration formats share: how a camera matrix and a lens are written down.
#pragma once

#include <string>
#include <vector>

#include "io/text/json_node.h"
#include "slam/geometry/camera_model.h"

namespace waymark::io {

// All of these put the first fault into their node's file and then go on.

// The list of numbers, however many there are.
[[nodiscard]] std::vector<double> readNumbers(const JsonNode& list);

// width, height: keys of whole numbers, pixels.
void readImageSize(const JsonNode& width, const JsonNode& height, slam::Calibration* calibration);

// The nine numbers of [fx 0 cx; 0 fy cy; 0 0 1], row by row. `node` names them in errors.
void takeCameraMatrix(const std::vector<double>& K, const JsonNode& node,
                      slam::Calibration* calibration);

// plumb_bob, radtan, rational_polynomial (one model: the last coefficients are zero), or
// equidistant, fisheye, fisheye_equidistant.
void takeDistortionModel(const std::string& name, const JsonNode& node,
                         slam::Calibration* calibration);

// OpenCV's order. 4, 5 or 8, or 12 or 14 of which those after the eighth are zero; an equidistant
// lens has 4. The model must be known already.
void takeDistortion(const std::vector<double>& coefficients, const JsonNode& node,
                    slam::Calibration* calibration);

}  // namespace waymark::io
