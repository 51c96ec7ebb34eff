// Debian's AprilTag detector: independent of everything here, to be measured against.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>

#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>

#include "base/image_view.h"
#include "simulator/projected_marker.h"

namespace waymark::simulator::testing {

// Of tag36h11, on one thread, at full resolution.
class AprilTagDetector {
 public:
  AprilTagDetector() {
    apriltag_detector_add_family(detector_, family_);
    detector_->quad_decimate = 1.0F;
    detector_->quad_sigma = 0.0F;
    detector_->refine_edges = 1;
    detector_->nthreads = 1;
  }
  AprilTagDetector(const AprilTagDetector&) = delete;
  AprilTagDetector& operator=(const AprilTagDetector&) = delete;
  ~AprilTagDetector() {
    apriltag_detector_destroy(detector_);
    tag36h11_destroy(family_);
  }

  // Corners by id, in our order and pixel convention; of an id found twice the last.
  std::map<int, ImageCorners> detect(const ImageView& image) {
    image_u8_t borrowed = {image.width, image.height, static_cast<std::int32_t>(image.stride),
                           const_cast<std::uint8_t*>(image.data)};
    zarray_t* const detections = apriltag_detector_detect(detector_, &borrowed);
    std::map<int, ImageCorners> found;
    for (int i = 0; i < zarray_size(detections); ++i) {
      apriltag_detection_t* detection = nullptr;
      zarray_get(detections, i, static_cast<void*>(&detection));
      // AprilTag: bottom-left, bottom-right, top-right, top-left; pixel edges.
      for (std::size_t k = 0; k < 4; ++k) {
        found[detection->id][k] = {detection->p[3 - k][0] - 0.5, detection->p[3 - k][1] - 0.5};
      }
    }
    apriltag_detections_destroy(detections);
    return found;
  }

 private:
  apriltag_detector_t* detector_ = apriltag_detector_create();
  apriltag_family_t* family_ = tag36h11_create();
};

}  // namespace waymark::simulator::testing
