// The pose of a picture from matched features, and the other pose that a plane's image leaves open.
#pragma once

#include <optional>
#include <span>

#include "slam/geometry/transform.h"
#include "slam/natural/pictures/natural_marker.h"
#include "slam/natural/pictures/picture_matcher.h"

namespace waymark::slam {

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
