// Detectors side by side: ours, and those of Debian's OpenCV and AprilTag.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <string>

#include <Eigen/Core>

#include "base/image_view.h"
#include "slam/geometry/camera_model.h"

namespace waymark::bench {

// Pixels, in our order of corners and with our pixel centres.
using Corners = std::array<Eigen::Vector2d, 4>;

class Detector {
 public:
  virtual ~Detector() = default;
  [[nodiscard]] virtual std::string name() const = 0;
  // By id; of an id found twice the last.
  virtual std::map<int, Corners> detect(const ImageView& image) = 0;
};

// Of tag36h11, which all three know. The camera must outlive the detector.
[[nodiscard]] std::unique_ptr<Detector> ourDetector(const slam::CameraModel& camera);
[[nodiscard]] std::unique_ptr<Detector> openCvDetector();
[[nodiscard]] std::unique_ptr<Detector> aprilTagDetector();

}  // namespace waymark::bench
