#include "io/calibrations/lens_keys.h"

#include <algorithm>
#include <cstddef>

namespace waymark::io {

std::vector<double> readNumbers(const JsonNode& list) {
  std::vector<double> values;
  for (const JsonNode& element : list.elements()) values.push_back(element.number());
  return values;
}

void readImageSize(const JsonNode& width, const JsonNode& height, slam::Calibration* calibration) {
  constexpr int kLargest = 1'000'000;
  calibration->width = static_cast<int>(width.integer(1, kLargest));
  calibration->height = static_cast<int>(height.integer(1, kLargest));
}

void takeCameraMatrix(const std::vector<double>& K, const JsonNode& node,
                      slam::Calibration* calibration) {
  if (!node.good()) return;
  if (K.size() != 9) return node.fail("must be 3x3");
  if (K[1] != 0.0 || K[3] != 0.0 || K[6] != 0.0 || K[7] != 0.0 || K[8] != 1.0) {
    return node.fail("must have the form [fx 0 cx; 0 fy cy; 0 0 1]");
  }
  calibration->fx = K[0];
  calibration->fy = K[4];
  calibration->cx = K[2];
  calibration->cy = K[5];
}

void takeDistortionModel(const std::string& name, const JsonNode& node,
                         slam::Calibration* calibration) {
  if (name == "plumb_bob" || name == "radtan" || name == "rational_polynomial") {
    calibration->model = slam::DistortionModel::kRational;
  } else if (name == "equidistant" || name == "fisheye" || name == "fisheye_equidistant") {
    calibration->model = slam::DistortionModel::kEquidistant;
  } else {
    node.fail("'" + name + "' is unknown; known: plumb_bob, radtan, rational_polynomial, " +
              "equidistant, fisheye, fisheye_equidistant");
  }
}

void takeDistortion(const std::vector<double>& coefficients, const JsonNode& node,
                    slam::Calibration* calibration) {
  if (!node.good()) return;
  const bool fisheye = calibration->model == slam::DistortionModel::kEquidistant;
  const std::size_t n = coefficients.size();
  const bool known = fisheye ? n == 4 : n == 4 || n == 5 || n == 8 || n == 12 || n == 14;
  if (!known) {
    return node.fail("has " + std::to_string(n) + " coefficients, " +
                     (fisheye ? "an equidistant lens has 4" : "must have 4, 5 or 8"));
  }
  const auto kept = std::min(n, calibration->distortion.size());
  const auto rest = coefficients.begin() + static_cast<std::ptrdiff_t>(kept);
  if (std::any_of(rest, coefficients.end(), [](double d) { return d != 0.0; })) {
    return node.fail("thin prism and tilt terms (from the ninth on) must be zero");
  }
  std::copy(coefficients.begin(), rest, calibration->distortion.begin());
}

}  // namespace waymark::io
