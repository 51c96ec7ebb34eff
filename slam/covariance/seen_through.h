// Poses that somebody has found in an image alone, of a plane whose size is known: with one lens,
// and as if all rows were of the same instant. What the map has learned of the camera since changes
// them: another lens, a rolling shutter, and how well either is known.
#pragma once

#include <cstdint>
#include <optional>

#include "slam/covariance/camera_uncertainty.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"
#include "slam/geometry/twist.h"

namespace waymark::slam {

// A frame, and what is known of its camera by now.
struct SeenThrough {
  const CameraModel& found_with;    // the lens that poses in this frame were found with
  const CameraUncertainty& by_now;  // the lens in use, and what is not known of it
  double readout_s = 0.0;           // first to last row
  Twist twist = Twist::Zero();      // of the camera in that frame; zero where it is not known
  std::int64_t monotonic_ns = 0;    // of the frame
};

// A camera in the frame of a plane: x right, y up, z towards the camera, the origin in its middle.
struct PoseAtPlane {
  Transform T_m_c;
  Matrix6d covariance = Matrix6d::Zero();  // of (dp, dtheta) of T_m_c: metres, radians
};

// Where the camera was at the middle row's time, as the lens in use has it, with that lens' and the
// readout's share in the covariance: points all over the plane stay where they are in the image.
// As it was where nothing has been learned. Empty where the lens in use cannot have seen the plane.
[[nodiscard]] std::optional<PoseAtPlane> seenThrough(const SeenThrough& frame,
                                                     const PoseAtPlane& found, double width_m,
                                                     double height_m);

}  // namespace waymark::slam
