#include "io/calibrations/ros_calibration.h"

#include <algorithm>
#include <vector>

#include "io/calibrations/lens_keys.h"
#include "io/text/number_text.h"

namespace waymark::io {
namespace {

// The full image, pixel by pixel?
void rejectParts(const JsonNode& root) {
  for (const char* key : {"binning_x", "binning_y"}) {
    if (root.has(key) && root.at(key).integer(0, 1000) > 1) {
      root.at(key).fail("binned images have another camera matrix than the message says");
    }
  }
  if (!root.has("roi")) return;
  for (const char* key : {"x_offset", "y_offset"}) {
    const JsonNode roi = root.at("roi");
    if (roi.has(key) && roi.at(key).integer(0, 1'000'000) != 0) {
      roi.at(key).fail("images of a region have another camera matrix than the message says");
    }
  }
}

std::string listText(const std::vector<double>& values) {
  std::string text = "[";
  for (std::size_t i = 0; i < values.size(); ++i) {
    std::string number = roundTrip(values[i]);
    // ROS's readers want numbers that cannot be taken for whole ones.
    if (number.find_first_of(".e") == std::string::npos) number += ".0";
    text += (i == 0 ? "" : ", ") + number;
  }
  return text + "]";
}

std::string matrixText(std::string_view key, int rows, int columns,
                       const std::vector<double>& values) {
  return std::string(key) + ":\n  rows: " + std::to_string(rows) +
         "\n  cols: " + std::to_string(columns) + "\n  data: " + listText(values) + "\n";
}

}  // namespace

bool isCameraInfoMessage(const Json& root) {
  return root.is_object() && (root.contains("K") || root.contains("k")) &&
         root.contains("distortion_model");
}

slam::Calibration readCameraInfoMessage(const JsonNode& root) {
  slam::Calibration calibration;
  const bool ros1 = root.has("K");
  readImageSize(root.at("width"), root.at("height"), &calibration);
  const JsonNode K = root.at(ros1 ? "K" : "k");
  takeCameraMatrix(readNumbers(K), K, &calibration);
  takeDistortionModel(root.at("distortion_model").text(), root.at("distortion_model"),
                      &calibration);
  const JsonNode D = root.at(ros1 ? "D" : "d");
  takeDistortion(readNumbers(D), D, &calibration);
  rejectParts(root);
  return calibration;
}

std::string formatCameraInfo(const slam::Calibration& c, std::string_view camera_name) {
  const bool fisheye = c.model == slam::DistortionModel::kEquidistant;
  const bool rational =
      std::any_of(c.distortion.begin() + 5, c.distortion.end(), [](double v) { return v != 0.0; });
  const int count = fisheye ? 4 : (rational ? 8 : 5);
  const std::vector<double> coefficients(c.distortion.begin(), c.distortion.begin() + count);

  std::string text = "image_width: " + std::to_string(c.width) + "\n";
  text += "image_height: " + std::to_string(c.height) + "\n";
  text += "camera_name: " + std::string(camera_name) + "\n";
  text += matrixText("camera_matrix", 3, 3, {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1});
  text += "distortion_model: ";
  text += fisheye ? "equidistant\n" : (rational ? "rational_polynomial\n" : "plumb_bob\n");
  text += matrixText("distortion_coefficients", 1, count, coefficients);
  text += matrixText("rectification_matrix", 3, 3, {1, 0, 0, 0, 1, 0, 0, 0, 1});
  // One camera: rectified images keep the camera matrix.
  text += matrixText("projection_matrix", 3, 4, {c.fx, 0, c.cx, 0, 0, c.fy, c.cy, 0, 0, 0, 1, 0});
  return text;
}

}  // namespace waymark::io
