#include "tests/bench/peers.h"

#include <vector>

#include <opencv2/aruco.hpp>

#include "simulator/testing/apriltag_detector.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/detection/marker_detector.h"

namespace waymark::bench {
namespace {

class OurDetector final : public Detector {
 public:
  explicit OurDetector(const slam::CameraModel& camera)
      : detector_(camera, *slam::Dictionary::byName("APRILTAG_36h11")) {}

  [[nodiscard]] std::string name() const override { return "waymark"; }
  std::map<int, ImageCorners> detect(const ImageView& image) override {
    std::map<int, ImageCorners> found;
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
  std::map<int, ImageCorners> detect(const ImageView& image) override {
    const cv::Mat grey(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.data),
                       static_cast<std::size_t>(image.stride));
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    cv::aruco::detectMarkers(grey, dictionary_, corners, ids, parameters_);
    std::map<int, ImageCorners> found;
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

class AprilTagDetector final : public Detector {
 public:
  [[nodiscard]] std::string name() const override { return "AprilTag 3"; }
  std::map<int, ImageCorners> detect(const ImageView& image) override {
    return detector_.detect(image);
  }

 private:
  simulator::testing::AprilTagDetector detector_;
};

}  // namespace

std::unique_ptr<Detector> ourDetector(const slam::CameraModel& camera) {
  return std::make_unique<OurDetector>(camera);
}
std::unique_ptr<Detector> openCvDetector() { return std::make_unique<OpenCvDetector>(); }
std::unique_ptr<Detector> aprilTagDetector() { return std::make_unique<AprilTagDetector>(); }

}  // namespace waymark::bench
