// From where a picture is found: by rendering it, small and tilted, and looking for it.
#pragma once

#include <optional>
#include <vector>

#include "slam/geometry/camera_model.h"
#include "slam/natural/pictures/natural_marker.h"
#include "slam/natural/pictures/picture_finder.h"

namespace waymark::tools {

struct PictureRange {
  double tilt_deg = 0.0;  // of the view from the print's normal
  // Found from both, and not from the distance after the farthest; empty: from none.
  std::optional<double> nearest_m;
  std::optional<double> farthest_m;
};

struct PictureRangeOptions {
  std::vector<double> tilts_deg = {0.0, 30.0, 45.0, 60.0};
  double step = 1.3;  // from one distance to the next, a factor
  double longest_m = 30.0;
  // A picture that is found neither from the nearest distance that has all of it in the image nor
  // from any up to so many times that far is not found from afar either.
  double nearest_times = 8.0;
  // A pose whose corners are farther off, pixels on average, is none.
  double right_px = 2.0;
};

// The camera that is taken where none is given: 640x480, 64 degrees across.
[[nodiscard]] slam::Calibration ordinaryCamera();

// Of picture `place` of the finder's set. The picture hangs on a plain wall, in good light.
[[nodiscard]] std::vector<PictureRange> pictureRange(const slam::NaturalMarker& marker, int place,
                                                     const slam::Calibration& camera,
                                                     slam::PictureFinder* finder,
                                                     const PictureRangeOptions& options = {});

}  // namespace waymark::tools
