// Cameras of Kalibr's camchain files.
#pragma once

#include <string>

#include "io/text/json_node.h"
#include "slam/geometry/camera_model.h"

namespace waymark::io {

// Whether it is a camchain: has a key cam0, cam1, ...
[[nodiscard]] bool isCamchain(const Json& root);

// Camera `name` ("cam1"); empty: the only one, and of several none is taken. Keys: camera_model
// (pinhole), intrinsics [fu fv pu pv], distortion_model (radtan, equidistant or none),
// distortion_coeffs, resolution [width height]. Faults go into the node's file.
[[nodiscard]] slam::Calibration readCamchain(const JsonNode& root, const std::string& name);

}  // namespace waymark::io
