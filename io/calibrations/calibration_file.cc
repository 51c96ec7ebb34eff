#include "io/calibrations/calibration_file.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "io/calibrations/kalibr_calibration.h"
#include "io/calibrations/lens_keys.h"
#include "io/calibrations/ros_calibration.h"
#include "io/text/json_node.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "io/text/yaml_text.h"

namespace waymark::io {
namespace {

constexpr const char* kCovariance = "intrinsics_covariance";

struct Place {
  std::filesystem::path file;
  std::string camera;  // of a camchain; may be empty
};

// "FILE#cam1", unless there is a file of that very name.
Place placeOf(const std::filesystem::path& path) {
  const std::string text = path.string();
  const std::size_t hash = text.rfind('#');
  std::error_code error;
  if (hash == std::string::npos || std::filesystem::exists(path, error)) return {path, ""};
  return {text.substr(0, hash), text.substr(hash + 1)};
}

// {rows, cols, data}, as OpenCV and ROS write matrices. `rows` 0: a row or a column.
std::vector<double> readMatrix(const JsonNode& matrix, int rows, int columns) {
  constexpr int kLargest = 1000;
  if (!matrix.json().is_object()) return matrix.fail("must be a matrix"), std::vector<double>{};
  const auto stored_rows = static_cast<int>(matrix.at("rows").integer(1, kLargest));
  const auto stored_columns = static_cast<int>(matrix.at("cols").integer(1, kLargest));
  const std::string size = std::to_string(stored_rows) + "x" + std::to_string(stored_columns);
  if (rows == 0 && std::min(stored_rows, stored_columns) != 1) {
    matrix.fail("is " + size + ", must be one row");
  } else if (rows != 0 && (stored_rows != rows || stored_columns != columns)) {
    matrix.fail("is " + size + ", must be " + std::to_string(rows) + "x" + std::to_string(columns));
  }
  const JsonNode data = matrix.at("data");
  std::vector<double> values = readNumbers(data);
  if (matrix.good() && std::cmp_not_equal(values.size(), stored_rows * stored_columns)) {
    data.fail("must be " + std::to_string(stored_rows * stored_columns) + " numbers");
  }
  return values;
}

// Where OpenCV and ROS name no model, it is the first; OpenCV's sample program has a key of its own
// for the second.
void readModel(const JsonNode& root, slam::Calibration* calibration) {
  if (root.has("distortion_model")) {
    const JsonNode model = root.at("distortion_model");
    takeDistortionModel(model.text(), model, calibration);
  } else if (root.has("fisheye_model") && root.at("fisheye_model").integer(0, 1) == 1) {
    calibration->model = slam::DistortionModel::kEquidistant;
  }
}

slam::IntrinsicMatrix readCovariance(const JsonNode& matrix) {
  using RowMajor = Eigen::Matrix<double, 9, 9, Eigen::RowMajor>;
  const std::vector<double> values = readMatrix(matrix, 9, 9);
  if (!matrix.good()) return slam::IntrinsicMatrix::Zero();
  return Eigen::Map<const RowMajor>(values.data());
}

slam::Calibration readOpenCvOrRos(const JsonNode& root) {
  slam::Calibration calibration;
  readImageSize(root.at("image_width"), root.at("image_height"), &calibration);
  const JsonNode K = root.at("camera_matrix");
  takeCameraMatrix(readMatrix(K, 3, 3), K, &calibration);
  readModel(root, &calibration);
  const JsonNode d = root.at("distortion_coefficients");
  takeDistortion(readMatrix(d, 0, 0), d, &calibration);
  if (root.has(kCovariance)) calibration.covariance = readCovariance(root.at(kCovariance));
  return calibration;
}

// Which format it is, shows in its keys.
slam::Calibration readAny(const JsonNode& root, const std::string& camera) {
  if (isCamchain(root.json())) return readCamchain(root, camera);
  if (!camera.empty()) return root.fail("has no camera '" + camera + "'"), slam::Calibration{};
  if (isCameraInfoMessage(root.json())) return readCameraInfoMessage(root);
  if (root.has("camera_matrix") || root.has("image_width")) return readOpenCvOrRos(root);
  root.fail(
      "is no calibration: has neither camera_matrix (OpenCV, ROS), nor K (a camera_info message), "
      "nor cam0 (Kalibr)");
  return {};
}

// camera: of several; empty where none was named.
Result<slam::Calibration> parseOf(const std::string& camera, const std::string& text,
                                  const std::string& name) {
  const Result<Json> yaml = parseYaml(text, name);
  if (!yaml) return yaml.error();
  std::string fault;
  const slam::Calibration calibration = readAny(JsonNode(*yaml, &fault), camera);
  if (fault.empty()) fault = calibration.invalidReason();
  if (!fault.empty()) return Error{name + ": " + fault};
  return calibration;
}

// As cv::FileStorage writes it, but with the shortest numbers that read back.
std::string openCvMatrix(const char* key, int rows, int columns, std::span<const double> values) {
  std::string text = std::string(key) + ": !!opencv-matrix\n   rows: " + std::to_string(rows) +
                     "\n   cols: " + std::to_string(columns) + "\n   dt: d\n   data: [ ";
  const char* separator = "";
  for (const double value : values) {
    text += separator + roundTrip(value);
    separator = ", ";
  }
  return text + " ]\n";
}

}  // namespace

Result<slam::Calibration> readCalibration(const std::filesystem::path& path) {
  const Place place = placeOf(path);
  const Result<std::string> text = readTextFile(place.file);
  if (!text) return text.error();
  return parseOf(place.camera, *text, place.file.string());
}

Result<slam::Calibration> parseCalibration(const std::string& text, const std::string& name) {
  return parseOf("", text, name);
}

std::string formatCalibration(const slam::Calibration& calibration) {
  const slam::Calibration& c = calibration;
  const bool fisheye = c.model == slam::DistortionModel::kEquidistant;
  const bool rational =
      std::any_of(c.distortion.begin() + 5, c.distortion.end(), [](double v) { return v != 0.0; });
  const int coefficients = fisheye ? 4 : (rational ? 8 : 5);

  std::string text = "%YAML:1.0\n---\n";
  text += "image_width: " + std::to_string(c.width) + "\n";
  text += "image_height: " + std::to_string(c.height) + "\n";
  const std::array<double, 9> K = {c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0};
  text += openCvMatrix("camera_matrix", 3, 3, K);
  text += "distortion_model: ";
  text += fisheye ? "fisheye_equidistant\n" : (rational ? "rational_polynomial\n" : "plumb_bob\n");
  text += openCvMatrix("distortion_coefficients", 1, coefficients,
                       std::span(c.distortion).first(static_cast<std::size_t>(coefficients)));
  if (c.covariance) {  // symmetric: by columns as by rows
    text += openCvMatrix(kCovariance, 9, 9, {c.covariance->data(), 81});
  }
  return text;
}

Status writeCalibration(const std::filesystem::path& path, const slam::Calibration& calibration) {
  return writeTextFile(path, formatCalibration(calibration));
}

}  // namespace waymark::io
