// From the configured source to a camera that can be opened, and the calibration it goes with.
#pragma once

#include <string>

#include "base/result.h"
#include "daemon/configuration.h"
#include "daemon/frames/capture_loop.h"
#include "slam/geometry/camera_model.h"

namespace waymark::daemon {

struct CameraSetup {
  slam::Calibration calibration;   // for pictures as they come
  std::string calibration_change;  // what was done to the file's for that; usually nothing
  SourceOpener opener;  // rejects a source whose pictures have another size than the calibration
};

// Reads what can be read before opening anything. A camera need not be there yet.
[[nodiscard]] Result<CameraSetup> prepareCamera(const Configuration& configuration);

}  // namespace waymark::daemon
