// Calibrations in each format there is. What is accepted makes a camera that answers, and a file
// that reads back bit for bit.
#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>

#include "io/calibrations/calibration_file.h"
#include "io/calibrations/ros_calibration.h"
#include "slam/geometry/camera_model.h"
#include "tests/fuzz/fuzz_target.h"

using namespace waymark;

namespace {

// As bits: -0.0 is not 0.0.
bool same(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

bool same(const slam::Calibration& a, const slam::Calibration& b) {
  const auto same_coefficient = [](double x, double y) { return same(x, y); };
  return a.width == b.width && a.height == b.height && a.model == b.model && same(a.fx, b.fx) &&
         same(a.fy, b.fy) && same(a.cx, b.cx) && same(a.cy, b.cy) &&
         std::equal(a.distortion.begin(), a.distortion.end(), b.distortion.begin(),
                    same_coefficient);
}

// The whole image and some of its surroundings.
void lookThrough(const slam::CameraModel& camera) {
  for (int row = -2; row <= 10; ++row) {
    for (int column = -2; column <= 10; ++column) {
      const Eigen::Vector2d pixel(0.125 * column * camera.width(), 0.125 * row * camera.height());
      const auto normalized = camera.undistort(pixel);
      if (!normalized) continue;
      fuzz::require(normalized->allFinite(), "undistorted points are finite");
      (void)camera.project({normalized->x(), normalized->y(), 1.0});
      (void)camera.intrinsicJacobian(*normalized);
    }
  }
  constexpr double kHuge = std::numeric_limits<double>::max();
  constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
  (void)camera.undistort({kHuge, -kHuge});
  (void)camera.undistort({kNothing, 0.0});
  (void)camera.project({kHuge, 0.0, 1e-6});
}

void readBack(const slam::Calibration& calibration, const std::string& text, const char* format) {
  const auto again = io::parseCalibration(text, "again.yml");
  fuzz::require(again.ok(), std::string(format) + " is read again: " +
                                (again ? std::string() : again.error().message) + "\n" + text);
  fuzz::require(same(*again, calibration), std::string(format) + " keeps every bit:\n" + text);
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto calibration = io::parseCalibration(fuzz::textOf(data, size), "calib.yml");
  if (!calibration) {
    fuzz::requireOneLine(calibration.error());
    return 0;
  }
  fuzz::require(calibration->invalidReason().empty(), "the calibration is valid");
  lookThrough(slam::CameraModel(*calibration));
  readBack(*calibration, io::formatCalibration(*calibration), "OpenCV's format");
  readBack(*calibration, io::formatCameraInfo(*calibration, "camera"), "ROS's format");
  return 0;
}
