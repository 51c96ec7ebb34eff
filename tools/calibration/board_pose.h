// The pose of a flat board in front of a known camera.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"
#include "tools/calibration/board_detector.h"

namespace waymark::calibration {

struct BoardPose {
  slam::Transform T_c_b;
  double rms_px = 0.0;  // root mean square distance between where points are and should be
};

// Of the two poses that a flat board may have, the one that fits better, refined. Empty where the
// camera cannot have seen the points.
[[nodiscard]] std::optional<BoardPose> boardPose(const std::vector<Eigen::Vector3d>& board,
                                                 std::span<const BoardPoint> points,
                                                 const slam::CameraModel& camera);

}  // namespace waymark::calibration
