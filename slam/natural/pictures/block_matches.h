// Where blocks of an expected picture are in the image: looked for around the places where they are
// expected. What hides a picture looks like none of its blocks; a picture that is not where it is
// taken to be (a line of text too low) looks like most of them, some pixels away.
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"
#include "slam/natural/pictures/grey_pyramid.h"
#include "slam/natural/pictures/photometric_fit.h"

namespace waymark::slam {

struct BlockMatch {
  Eigen::Vector3d on_print;    // the block's centre, metres, z = 0
  Eigen::Vector2d normalized;  // where it is, undistorted
};

struct BlockMatchOptions {
  int block_px = 8;          // a side, pixels of the level
  int reach_px = 6;          // it is looked for so far away, each way
  double contrast = 4.0;     // of what is expected, at least (standard deviation of grey levels)
  double correlation = 0.8;  // of expected and seen, at least
};

// level: of the image that the pixels are of. Blocks with texture that are nowhere are left out.
[[nodiscard]] std::vector<BlockMatch> matchBlocks(const std::vector<PhotometricPixel>& pixels,
                                                  const GreyLevels& image, int level,
                                                  const CameraModel& camera,
                                                  const BlockMatchOptions& options = {});

// The pose from which most of them are where they were found. Empty with too few.
[[nodiscard]] std::optional<Transform> poseFromBlocks(const Transform& start,
                                                      const std::vector<BlockMatch>& matches,
                                                      double focal_px, double kernel_px);

}  // namespace waymark::slam
