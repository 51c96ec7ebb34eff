// Camera calibrations as OpenCV FileStorage YAML, the format its calibration tools write.
#pragma once

#include <filesystem>
#include <string>

#include "base/result.h"
#include "slam/geometry/camera_model.h"

namespace waymark::io {

// Keys: image_width, image_height (pixels), camera_matrix (3x3), distortion_coefficients (4, 5 or 8
// of them; 12 or 14 when those after the eighth are zero), and optionally distortion_model:
// plumb_bob, radtan or rational_polynomial (the default), or equidistant, fisheye or
// fisheye_equidistant (4 coefficients). The error names the file and the key.
[[nodiscard]] Result<slam::Calibration> readCalibration(const std::filesystem::path& path);

// Reads back bit for bit. Precondition: calibration.invalidReason() is empty.
[[nodiscard]] std::string formatCalibration(const slam::Calibration& calibration);
[[nodiscard]] Status writeCalibration(const std::filesystem::path& path,
                                      const slam::Calibration& calibration);

}  // namespace waymark::io
