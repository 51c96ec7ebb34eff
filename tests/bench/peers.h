// Detectors side by side: ours, and those of Debian's OpenCV and AprilTag.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "base/image_view.h"
#include "simulator/projected_marker.h"
#include "slam/geometry/camera_model.h"

namespace waymark::bench {

using simulator::ImageCorners;

class Detector {
 public:
  virtual ~Detector() = default;
  [[nodiscard]] virtual std::string name() const = 0;
  // Corners by id, in our order and pixel convention; of an id found twice the last.
  virtual std::map<int, ImageCorners> detect(const ImageView& image) = 0;
};

// Of tag36h11, which all three know. The camera must outlive the detector.
[[nodiscard]] std::unique_ptr<Detector> ourDetector(const slam::CameraModel& camera);
[[nodiscard]] std::unique_ptr<Detector> openCvDetector();
[[nodiscard]] std::unique_ptr<Detector> aprilTagDetector();

}  // namespace waymark::bench
