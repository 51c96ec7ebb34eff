#include "io/calibrations/kalibr_calibration.h"

#include <algorithm>
#include <cctype>
#include <string_view>
#include <vector>

#include "io/calibrations/lens_keys.h"

namespace waymark::io {
namespace {

// "cam" and a number.
bool isCameraKey(std::string_view key) {
  return key.size() > 3 && key.starts_with("cam") &&
         std::all_of(key.begin() + 3, key.end(), [](unsigned char c) { return std::isdigit(c); });
}

std::vector<std::string> cameraKeys(const Json& root) {
  std::vector<std::string> keys;
  for (const auto& [key, value] : root.items()) {
    if (isCameraKey(key)) keys.push_back(key);
  }
  return keys;
}

// Empty, with a fault, when it is not clear which one.
std::string chosenKey(const JsonNode& root, const std::string& name) {
  const std::vector<std::string> keys = cameraKeys(root.json());
  std::string known;
  for (const std::string& key : keys) known += (known.empty() ? "" : ", ") + key;
  if (name.empty() && keys.size() == 1) return keys.front();
  if (name.empty()) {
    root.fail("has several cameras (" + known + "); write FILE#" + keys.front() + " to say which");
    return {};
  }
  if (std::find(keys.begin(), keys.end(), name) != keys.end()) return name;
  root.fail("has no camera '" + name + "', but " + known);
  return {};
}

void readLens(const JsonNode& camera, slam::Calibration* calibration) {
  const JsonNode model = camera.at("distortion_model");
  const std::string name = model.text();
  const bool none = name == "none";
  if (name != "radtan" && name != "equidistant" && !none) {
    return model.fail("'" + name + "' is unknown; known: radtan, equidistant, none");
  }
  if (none) return;
  takeDistortionModel(name, model, calibration);
  const JsonNode coefficients = camera.at("distortion_coeffs");
  const std::vector<double> values = readNumbers(coefficients);
  if (coefficients.good() && values.size() != 4) return coefficients.fail("must be 4 numbers");
  takeDistortion(values, coefficients, calibration);
}

}  // namespace

bool isCamchain(const Json& root) { return root.is_object() && !cameraKeys(root).empty(); }

slam::Calibration readCamchain(const JsonNode& root, const std::string& name) {
  slam::Calibration calibration;
  const std::string key = chosenKey(root, name);
  if (!root.good()) return calibration;
  const JsonNode camera = root.at(key.c_str());
  const JsonNode model = camera.at("camera_model");
  if (const std::string lens = model.text(); lens != "pinhole") {
    model.fail("'" + lens + "' is unknown; known: pinhole");
  }
  const std::vector<double> intrinsics = camera.at("intrinsics").numbers(4);
  calibration.fx = intrinsics[0];
  calibration.fy = intrinsics[1];
  calibration.cx = intrinsics[2];
  calibration.cy = intrinsics[3];
  readLens(camera, &calibration);
  const std::vector<JsonNode> size = camera.at("resolution").elements(2);
  if (root.good()) readImageSize(size[0], size[1], &calibration);
  return calibration;
}

}  // namespace waymark::io
