// One lens in the terms of another distortion model.
#pragma once

#include <optional>

#include "slam/geometry/camera_model.h"

namespace waymark::slam {

// What a lens that nobody has measured is expected to be, in a model's terms: without distortion
// there (a pinhole's image is not what is expected of an equidistant lens), else as guessed.
[[nodiscard]] CameraModel withoutDistortion(DistortionModel model, const CameraModel& guess);

// The lens of the other model that puts rays where this one does, as nearly as it can: least
// squares over a grid of pixels. Empty where that comes to no lens.
[[nodiscard]] std::optional<CameraModel> inModel(DistortionModel model, const CameraModel& camera);

// The same as it is, in the model of another lens; that one where there is none.
[[nodiscard]] CameraModel asLens(const CameraModel& camera, const CameraModel& other);

// What a lens is expected to be, in the model of another one: as somebody has measured it, or as it
// was guessed.
[[nodiscard]] CameraModel expectedAs(const CameraModel& given, bool measured,
                                     const CameraModel& other);

}  // namespace waymark::slam
