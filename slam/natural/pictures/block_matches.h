// Where blocks of an expected picture are in the image: looked for around the places where they are
// expected. What hides a picture looks like none of its blocks; a picture that is not where it is
// taken to be (a line of text too low) looks like most of them, some pixels away.
#pragma once

#include <vector>

#include "slam/geometry/camera_model.h"
#include "slam/natural/pictures/grey_pyramid.h"
#include "slam/natural/pictures/photometric_fit.h"
#include "slam/natural/pictures/picture_pose.h"

namespace waymark::slam {

struct BlockMatchOptions {
  int block_px = 8;          // a side, pixels of the level
  int reach_px = 6;          // it is looked for so far away, each way
  double contrast = 4.0;     // of what is expected, at least (standard deviation of grey levels)
  double correlation = 0.8;  // of expected and seen, at least
};

// The centres of the blocks that were found. level: of the image that the pixels are of. Left out:
// those without texture, and those that are nowhere.
[[nodiscard]] std::vector<PrintPoint> matchBlocks(const std::vector<PhotometricPixel>& pixels,
                                                  const GreyLevels& image, int level,
                                                  const CameraModel& camera,
                                                  const BlockMatchOptions& options = {});

}  // namespace waymark::slam
