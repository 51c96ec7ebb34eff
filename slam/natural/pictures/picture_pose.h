// The pose of a picture from matched features, and the other pose that a plane's image leaves open.
#pragma once

#include <optional>
#include <span>

#include "slam/geometry/minimize_pose.h"
#include "slam/geometry/transform.h"
#include "slam/natural/pictures/natural_marker.h"
#include "slam/natural/pictures/picture_matcher.h"

namespace waymark::slam {

// Where a point of a print is in the image.
struct PrintPoint {
  Eigen::Vector3d on_print;    // metres, z = 0
  Eigen::Vector2d normalized;  // undistorted
};

// The pose, near `start`, from which the points are where they are seen, by a robust kernel (Huber)
// of kernel_px. Empty where one is behind the camera at the start.
[[nodiscard]] std::optional<MinimizedPose> poseFromPoints(const Transform& start,
                                                          std::span<const PrintPoint> points,
                                                          double focal_px, double kernel_px);

// Of the two poses whose image is like the candidate's, refined on its matches with a robust kernel
// of `kernel_px`, the one that fits better. Empty when the place is not the image of a print in
// front of the camera.
[[nodiscard]] std::optional<Transform> poseFromMatches(const PictureCandidate& candidate,
                                                       const NaturalMarker& marker,
                                                       std::span<const ImageFeature> image,
                                                       double focal_px, double kernel_px = 1.5);

// The pose that looks most like T_c_p without being it (the mirrored tilt). Empty when there is
// none: the picture is so large or near that only one pose has its image.
[[nodiscard]] std::optional<Transform> mirroredPose(const Transform& T_c_p, double size_m,
                                                    double focal_px);

}  // namespace waymark::slam
