#include "io/calibration_file.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "io/number_text.h"
#include "io/text_file.h"

namespace waymark::io {
namespace {

// Reads keys of one file. The first fault is kept; later reads then do nothing.
class Reader {
 public:
  Reader(const std::string& file, const cv::FileStorage& storage)
      : file_(file), storage_(storage) {}

  [[nodiscard]] const std::string& fault() const { return fault_; }

  int positiveInteger(const char* key) {
    const cv::FileNode node = find(key);
    if (!fault_.empty()) return 0;
    const double value = node.isInt() || node.isReal() ? static_cast<double>(node) : 0.0;
    if (!(value >= 1.0 && value <= 1e6) || value != std::floor(value)) {
      return fail(key, "must be a positive whole number"), 0;
    }
    return static_cast<int>(value);
  }

  std::string textOr(const char* key, const std::string& fallback) {
    const cv::FileNode node = storage_[key];
    if (node.empty()) return fallback;
    if (!node.isString()) return fail(key, "must be a name"), fallback;
    return static_cast<std::string>(node);
  }

  // The entries of a matrix, row by row; *rows and *columns are its size.
  std::vector<double> matrix(const char* key, int* rows, int* columns) {
    const cv::FileNode node = find(key);
    if (!fault_.empty()) return {};
    cv::Mat stored;
    try {
      node >> stored;
    } catch (const cv::Exception&) {
      stored.release();
    }
    if (stored.empty() || stored.dims != 2 || stored.channels() != 1) {
      return fail(key, "must be a matrix of numbers"), std::vector<double>{};
    }
    cv::Mat_<double> values;
    stored.convertTo(values, CV_64F);
    if (!std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); })) {
      return fail(key, "has a value that is not finite"), std::vector<double>{};
    }
    *rows = values.rows;
    *columns = values.cols;
    return {values.begin(), values.end()};
  }

  void fail(const char* key, const std::string& reason) {
    if (fault_.empty()) fault_ = file_ + ": " + key + ": " + reason;
  }

 private:
  cv::FileNode find(const char* key) {
    const cv::FileNode node = storage_[key];
    if (node.empty()) fail(key, "is missing");
    return node;
  }

  std::string file_;
  const cv::FileStorage& storage_;
  std::string fault_;
};

void readCameraMatrix(Reader& reader, slam::Calibration* calibration) {
  constexpr const char* kKey = "camera_matrix";
  int rows = 0;
  int columns = 0;
  const std::vector<double> K = reader.matrix(kKey, &rows, &columns);
  if (!reader.fault().empty()) return;
  if (rows != 3 || columns != 3) {
    return reader.fail(
        kKey, "is " + std::to_string(rows) + "x" + std::to_string(columns) + ", must be 3x3");
  }
  if (K[1] != 0.0 || K[3] != 0.0 || K[6] != 0.0 || K[7] != 0.0 || K[8] != 1.0) {
    return reader.fail(kKey, "must have the form [fx 0 cx; 0 fy cy; 0 0 1]");
  }
  calibration->fx = K[0];
  calibration->fy = K[4];
  calibration->cx = K[2];
  calibration->cy = K[5];
}

void readDistortionModel(Reader& reader, slam::Calibration* calibration) {
  constexpr const char* kKey = "distortion_model";
  const std::string name = reader.textOr(kKey, "plumb_bob");
  if (name == "plumb_bob" || name == "radtan" || name == "rational_polynomial") {
    calibration->model = slam::DistortionModel::kRational;
  } else if (name == "equidistant" || name == "fisheye" || name == "fisheye_equidistant") {
    calibration->model = slam::DistortionModel::kEquidistant;
  } else {
    reader.fail(kKey, "'" + name + "' is unknown; known: plumb_bob, radtan, rational_polynomial, " +
                          "equidistant, fisheye, fisheye_equidistant");
  }
}

void readDistortion(Reader& reader, slam::Calibration* calibration) {
  constexpr const char* kKey = "distortion_coefficients";
  int rows = 0;
  int columns = 0;
  const std::vector<double> d = reader.matrix(kKey, &rows, &columns);
  if (!reader.fault().empty()) return;
  const bool fisheye = calibration->model == slam::DistortionModel::kEquidistant;
  const std::size_t n = d.size();
  const bool known = fisheye ? n == 4 : n == 4 || n == 5 || n == 8 || n == 12 || n == 14;
  if (std::min(rows, columns) != 1 || !known) {
    return reader.fail(kKey, "is " + std::to_string(rows) + "x" + std::to_string(columns) +
                                 (fisheye ? ", a fisheye lens has 4 coefficients in one row"
                                          : ", must be 4, 5 or 8 coefficients in one row"));
  }
  for (std::size_t i = calibration->distortion.size(); i < n; ++i) {
    if (d[i] != 0.0) {
      return reader.fail(kKey, "thin prism and tilt terms (from the ninth on) must be zero");
    }
  }
  std::copy_n(d.begin(), std::min(n, calibration->distortion.size()),
              calibration->distortion.begin());
}

}  // namespace

Result<slam::Calibration> readCalibration(const std::filesystem::path& path) {
  const Result<std::string> text = readTextFile(path);
  if (!text) return text.error();
  const std::string file = path.string();
  const Error not_yaml{file + ": is not an OpenCV YAML file"};
  if (text->rfind("%YAML", 0) != 0) return Error{not_yaml.message + " (must begin with %YAML)"};

  try {
    const cv::FileStorage storage(*text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    if (!storage.isOpened()) return not_yaml;
    Reader reader(file, storage);
    slam::Calibration calibration;
    calibration.width = reader.positiveInteger("image_width");
    calibration.height = reader.positiveInteger("image_height");
    readCameraMatrix(reader, &calibration);
    readDistortionModel(reader, &calibration);
    readDistortion(reader, &calibration);
    if (!reader.fault().empty()) return Error{reader.fault()};
    if (const std::string reason = calibration.invalidReason(); !reason.empty()) {
      return Error{file + ": " + reason};
    }
    return calibration;
  } catch (const cv::Exception&) {
    return not_yaml;
  }
}

std::string formatCalibration(const slam::Calibration& calibration) {
  const slam::Calibration& c = calibration;
  const bool fisheye = c.model == slam::DistortionModel::kEquidistant;
  const bool rational =
      std::any_of(c.distortion.begin() + 5, c.distortion.end(), [](double v) { return v != 0.0; });
  const int coefficients = fisheye ? 4 : (rational ? 8 : 5);

  // By hand rather than with cv::FileStorage: shortest round-trip numbers, and no exceptions.
  std::string text = "%YAML:1.0\n---\n";
  text += "image_width: " + std::to_string(c.width) + "\n";
  text += "image_height: " + std::to_string(c.height) + "\n";
  text += "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n";
  text += "   data: [ " + roundTrip(c.fx) + ", 0., " + roundTrip(c.cx) + ", 0., " +
          roundTrip(c.fy) + ", " + roundTrip(c.cy) + ", 0., 0., 1. ]\n";
  text += "distortion_model: ";
  text += fisheye ? "fisheye_equidistant\n" : (rational ? "rational_polynomial\n" : "plumb_bob\n");
  text += "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: " +
          std::to_string(coefficients) + "\n   dt: d\n   data: [ ";
  for (int i = 0; i < coefficients; ++i) {
    if (i > 0) text += ", ";
    text += roundTrip(c.distortion[static_cast<std::size_t>(i)]);
  }
  return text + " ]\n";
}

Status writeCalibration(const std::filesystem::path& path, const slam::Calibration& calibration) {
  return writeTextFile(path, formatCalibration(calibration));
}

}  // namespace waymark::io
