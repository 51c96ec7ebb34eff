#include "slam/geometry/calibration_fit.h"

#include <array>
#include <cmath>
#include <optional>

#include "base/image_view.h"

namespace waymark::slam {
namespace {

// Scaled pictures have the left and upper edge in common, at -0.5 where pixels count from centres.
double scaledCentre(double centre, double scale) { return (centre + 0.5) * scale - 0.5; }

std::optional<Calibration> scaled(const Calibration& c, int width, int height) {
  const double sx = static_cast<double>(width) / c.width;
  const double sy = static_cast<double>(height) / c.height;
  if (std::abs(c.height * sx - height) >= 1.0 && std::abs(c.width * sy - width) >= 1.0) {
    return std::nullopt;
  }
  Calibration result = c;
  result.width = width;
  result.height = height;
  result.fx = c.fx * sx;
  result.fy = c.fy * sy;
  result.cx = scaledCentre(c.cx, sx);
  result.cy = scaledCentre(c.cy, sy);
  if (c.covariance) {
    IntrinsicVector by = IntrinsicVector::Ones();
    by.head<4>() << sx, sy, sx, sy;
    result.covariance = by.asDiagonal() * *c.covariance * by.asDiagonal();
  }
  return result;
}

std::optional<Calibration> cropped(const Calibration& c, int width, int height) {
  const int less_wide = c.width - width;
  const int less_high = c.height - height;
  if (less_wide < 0 || less_high < 0 || less_wide % 2 != 0 || less_high % 2 != 0) {
    return std::nullopt;
  }
  Calibration result = c;
  result.width = width;
  result.height = height;
  result.cx = c.cx - 0.5 * less_wide;
  result.cy = c.cy - 0.5 * less_high;
  return result;
}

std::optional<Calibration> fitted(const Calibration& c, int width, int height, CalibrationFit fit) {
  if (fit == CalibrationFit::kExact) return std::nullopt;
  const auto result =
      fit == CalibrationFit::kScale ? scaled(c, width, height) : cropped(c, width, height);
  if (!result || !result->invalidReason().empty()) return std::nullopt;
  return result;
}

}  // namespace

std::string_view fitName(CalibrationFit fit) {
  constexpr std::array<std::string_view, 3> kNames = {"exact", "scale", "crop"};
  return kNames[static_cast<std::size_t>(fit)];
}

Result<FittedCalibration> fitCalibration(const Calibration& calibration, int width, int height,
                                         CalibrationFit fit) {
  if (width == calibration.width && height == calibration.height) {
    return FittedCalibration{calibration, ""};
  }
  const std::string from = sizeText(calibration.width, calibration.height);
  const std::string to = sizeText(width, height);
  if (const auto result = fitted(calibration, width, height, fit)) {
    const std::string how = fit == CalibrationFit::kScale ? "scaled" : "cropped";
    return FittedCalibration{*result, how + " from " + from + " to " + to};
  }
  std::string others;
  for (const CalibrationFit other : {CalibrationFit::kScale, CalibrationFit::kCrop}) {
    if (!fitted(calibration, width, height, other)) continue;
    others += others.empty() ? "'" : " or '";
    others += fitName(other);
    others += "'";
  }
  const std::string why =
      fit == CalibrationFit::kExact ? "" : ", which is no " + std::string(fitName(fit)) + " of it";
  return Error{"the pictures are " + to + ", but the calibration is for " + from + why +
               (others.empty() ? "" : "; the calibration fit " + others + " would take them")};
}

}  // namespace waymark::slam
