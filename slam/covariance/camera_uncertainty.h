// What is not known exactly of the camera: its intrinsics, and the readout time of a rolling
// shutter. Whatever was seen through it errs together, poses as the map: consider parameters, in
// the terms of estimation.
#pragma once

#include <cstdint>
#include <limits>

#include "slam/geometry/camera_model.h"
#include "slam/geometry/twist.h"
#include "slam/optimization/bundle_problem.h"

namespace waymark::slam {

struct CameraUncertainty {
  const CameraModel* camera = nullptr;  // in use
  // Of the intrinsics, in the order of IntrinsicVector, and of the readout time, seconds. Zero for
  // what is known.
  GlobalMatrix covariance = GlobalMatrix::Zero();
  // The intrinsics are of frames since then, nanoseconds (monotonic).
  std::int64_t since_ns = std::numeric_limits<std::int64_t>::min();

  // The parameters that are not known lie together: from the first one, so many.
  struct Unknown {
    int first = 0;
    int count = 0;
    bool operator==(const Unknown&) const = default;
  };
  [[nodiscard]] Unknown unknown() const;
};

using CornerByCamera = Eigen::Matrix<double, 2, BundleProblem::kGlobals>;

// d normalized / d parameters of a corner that stays where it is in the image; zero for parameters
// that are known. twist: of the camera in that frame, seen at time_ns. Precondition: p_c, the
// corner in the camera frame, is in front of it.
[[nodiscard]] CornerByCamera cornerByCamera(const CameraUncertainty& camera,
                                            const Eigen::Vector2d& pixel,
                                            const Eigen::Vector3d& p_c, const Twist& twist,
                                            std::int64_t time_ns);

}  // namespace waymark::slam
