// From the configured source to a camera that can be opened, and the calibration it goes with.
#pragma once

#include "base/result.h"
#include "daemon/capture_loop.h"
#include "daemon/configuration.h"
#include "slam/geometry/camera_model.h"

namespace waymark::daemon {

struct CameraSetup {
  slam::Calibration calibration;
  double rate_hz = 0.0;  // nominal; 0 when only the opened source knows
  SourceOpener opener;   // refuses a source whose pictures have another size than the calibration
};

// Reads what can be read before opening anything.
[[nodiscard]] Result<CameraSetup> prepareCamera(const Configuration& configuration);

}  // namespace waymark::daemon
