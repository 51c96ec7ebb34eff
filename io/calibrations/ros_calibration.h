// Calibrations of ROS: sensor_msgs/CameraInfo, as a file and as a printed message.
#pragma once

#include <string>
#include <string_view>

#include "io/text/json_node.h"
#include "slam/geometry/camera_model.h"

namespace waymark::io {

// Whether it is a camera_info message as `rostopic echo` (K, D) or `ros2 topic echo` (k, d) prints
// it.
[[nodiscard]] bool isCameraInfoMessage(const Json& root);

// Keys: width, height, distortion_model, and K, D or k, d. Binned or cut-out images are rejected:
// the matrix is not theirs. Faults go into the node's file.
[[nodiscard]] slam::Calibration readCameraInfoMessage(const JsonNode& root);

// A camera_info file for ROS's camera_info_manager: distortion_model plumb_bob,
// rational_polynomial or equidistant. Numbers read back bit for bit. `camera_name` is text without
// quotes or newlines. Precondition: calibration.invalidReason() is empty.
[[nodiscard]] std::string formatCameraInfo(const slam::Calibration& calibration,
                                           std::string_view camera_name);

}  // namespace waymark::io
