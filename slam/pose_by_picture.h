// Where a photograph was taken, as a picture of the map says that was found in it: of images in no
// order no features are followed, and an answer acts where it was found.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "slam/covariance/camera_uncertainty.h"
#include "slam/late_result.h"
#include "slam/map/map.h"
#include "slam/pose_estimate.h"

namespace waymark::slam {

struct PoseByPicture {
  PoseEstimate pose;  // both covariances relative to the picture
  int picture = -1;   // its id
};

// By the picture that tells it best. found: in the image, through the lens in use. Empty where the
// map has a place for none of them, or which of a picture's two poses it is is open.
[[nodiscard]] std::optional<PoseByPicture> poseByPicture(std::span<const LateResult> found,
                                                         std::int64_t time_ns,
                                                         const CameraUncertainty& camera,
                                                         const Map& map);

}  // namespace waymark::slam
