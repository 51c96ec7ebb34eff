#include "bench/peers.h"

#include <vector>

#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#include <opencv2/aruco.hpp>

#include "slam/detection/dictionary.h"
#include "slam/detection/marker_detector.h"

namespace waymark::bench {
namespace {

class OurDetector final : public Detector {
 public:
  explicit OurDetector(const slam::CameraModel& camera)
      : detector_(camera, *slam::Dictionary::byName("APRILTAG_36h11")) {}

  [[nodiscard]] std::string name() const override { return "waymark"; }
  std::map<int, Corners> detect(const ImageView& image) override {
    std::map<int, Corners> found;
    for (const auto& detection : detector_.detect(image)) found[detection.id] = detection.pixels;
    return found;
  }

 private:
  slam::MarkerDetector detector_;
};

// With sub-pixel corners, as its users who want accuracy set it.
class OpenCvDetector final : public Detector {
 public:
  OpenCvDetector() { parameters_->cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX; }

  [[nodiscard]] std::string name() const override { return "OpenCV ArUco"; }
  std::map<int, Corners> detect(const ImageView& image) override {
    const cv::Mat grey(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.data),
                       static_cast<std::size_t>(image.stride));
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    cv::aruco::detectMarkers(grey, dictionary_, corners, ids, parameters_);
    std::map<int, Corners> found;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      // OpenCV draws this family turned by half a turn.
      for (std::size_t k = 0; k < 4; ++k) {
        const cv::Point2f& p = corners[i][(k + 2) % 4];
        found[ids[i]][k] = {p.x, p.y};
      }
    }
    return found;
  }

 private:
  cv::Ptr<cv::aruco::Dictionary> dictionary_ =
      cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
  cv::Ptr<cv::aruco::DetectorParameters> parameters_ = cv::aruco::DetectorParameters::create();
};

// On one thread, at full resolution.
class AprilTagDetector final : public Detector {
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
  ~AprilTagDetector() override {
    apriltag_detector_destroy(detector_);
    tag36h11_destroy(family_);
  }

  [[nodiscard]] std::string name() const override { return "AprilTag 3"; }
  std::map<int, Corners> detect(const ImageView& image) override {
    image_u8_t borrowed = {image.width, image.height, static_cast<std::int32_t>(image.stride),
                           const_cast<std::uint8_t*>(image.data)};
    zarray_t* const detections = apriltag_detector_detect(detector_, &borrowed);
    std::map<int, Corners> found;
    for (int i = 0; i < zarray_size(detections); ++i) {
      apriltag_detection_t* detection = nullptr;
      zarray_get(detections, i, static_cast<void*>(&detection));
      // Bottom-left, bottom-right, top-right, top-left, from pixel edges.
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

}  // namespace

std::unique_ptr<Detector> ourDetector(const slam::CameraModel& camera) {
  return std::make_unique<OurDetector>(camera);
}
std::unique_ptr<Detector> openCvDetector() { return std::make_unique<OpenCvDetector>(); }
std::unique_ptr<Detector> aprilTagDetector() { return std::make_unique<AprilTagDetector>(); }

}  // namespace waymark::bench
