// A calibration for pictures of another size than it was made with: the same sensor read out at
// another scale, or only its middle.
#pragma once

#include <string>
#include <string_view>

#include "base/result.h"
#include "slam/geometry/camera_model.h"

namespace waymark::slam {

// What another size may mean. The pictures themselves do not tell, so somebody has to say so.
enum class CalibrationFit {
  kExact,  // nothing: sizes must be equal
  kScale,  // the whole field of view, at another scale, with the same aspect
  kCrop,   // the same scale, cut off equally at opposite sides
};

// "exact", "scale", "crop".
[[nodiscard]] std::string_view fitName(CalibrationFit fit);

struct FittedCalibration {
  Calibration calibration;
  std::string change;  // for people: "scaled from 1280x960 to 640x480"; empty when nothing changed
};

// Equal sizes fit always. Scaling takes sizes of one aspect, within the pixel that rounding may
// cost; a crop takes even differences only, since half a pixel more at one side is not centred. The
// error says both sizes, and which other fit would take them.
[[nodiscard]] Result<FittedCalibration> fitCalibration(const Calibration& calibration, int width,
                                                       int height, CalibrationFit fit);

}  // namespace waymark::slam
