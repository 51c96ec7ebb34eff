#include "daemon/camera_setup.h"

#include <optional>
#include <string>
#include <utility>

#include "capture/open_source.h"
#include "io/calibration_file.h"

namespace waymark::daemon {
namespace {

using OpenResult = Result<std::unique_ptr<capture::FrameSource>>;

std::string inWords(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

// The SLAM takes pictures of exactly the size its calibration is for.
OpenResult matching(OpenResult opened, const slam::Calibration& calibration) {
  if (!opened) return opened;
  const capture::StreamInfo& info = (*opened)->info();
  if (info.width == calibration.width && info.height == calibration.height) return opened;
  return Error{info.description + ": the pictures are " + inWords(info.width, info.height) +
               ", but the calibration is for " +
               inWords(calibration.width, calibration.height)};
}

CameraSetup recordingSetup(const Configuration::Camera& camera,
                           const slam::Calibration& calibration) {
  capture::SourceOptions options;
  options.realtime = true;
  if (camera.rate_hz > 0.0) options.fps = camera.rate_hz;
  CameraSetup setup{.calibration = calibration, .rate_hz = camera.rate_hz, .opener = {}};
  setup.opener.open = [source = camera.source, options, calibration] {
    return matching(capture::openSource(source, options), calibration);
  };
  return setup;
}

}  // namespace

Result<CameraSetup> prepareCamera(const Configuration& configuration) {
  const Configuration::Camera& camera = configuration.camera;
  Result<slam::Calibration> calibration = io::readCalibration(camera.calibration);
  if (!calibration) return calibration.error();
  return recordingSetup(camera, *calibration);
}

}  // namespace waymark::daemon
