// Camera calibrations: YAML of OpenCV, ROS and Kalibr in, of OpenCV out (of ROS:
// ros_calibration.h).
#pragma once

#include <filesystem>
#include <string>

#include "base/result.h"
#include "slam/geometry/camera_model.h"

namespace waymark::io {

// The format shows in the keys:
// - OpenCV and ROS camera_info: image_width, image_height (pixels), camera_matrix (3x3),
//   distortion_coefficients (4, 5 or 8 of them; 12 or 14 when those after the eighth are zero), and
//   optionally distortion_model: plumb_bob, radtan or rational_polynomial (the default), or
//   equidistant, fisheye or fisheye_equidistant (4 coefficients); or OpenCV's fisheye_model: 1;
//   and, which other programs pass over, intrinsics_covariance (9x9, of fx fy cx cy k1 k2 p1 p2 k3,
//   or of fx fy cx cy k1 k2 k3 k4 and a zero): how well they are known;
// - a camera_info message as ROS prints it (ros_calibration.h);
// - a camchain of Kalibr (kalibr_calibration.h). Of several cameras, "FILE#cam1" names one.
// The error names the file and the key.
[[nodiscard]] Result<slam::Calibration> readCalibration(const std::filesystem::path& path);

// The same from text; `name` is for errors.
[[nodiscard]] Result<slam::Calibration> parseCalibration(const std::string& text,
                                                         const std::string& name);

// OpenCV FileStorage. Reads back bit for bit. Precondition: calibration.invalidReason() is empty.
[[nodiscard]] std::string formatCalibration(const slam::Calibration& calibration);
[[nodiscard]] Status writeCalibration(const std::filesystem::path& path,
                                      const slam::Calibration& calibration);

}  // namespace waymark::io
