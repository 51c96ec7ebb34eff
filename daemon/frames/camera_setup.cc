#include "daemon/frames/camera_setup.h"

#include <memory>
#include <string>
#include <utility>

#include "base/image_view.h"
#include "capture/open_source.h"
#include "io/calibrations/calibration_file.h"
#include "simulator/live_source.h"

namespace waymark::daemon {
namespace {

using OpenResult = Result<std::unique_ptr<capture::FrameSource>>;

constexpr std::string_view kSimulated = "sim:";

// The SLAM takes pictures of exactly the size its calibration is for.
OpenResult matching(OpenResult opened, const slam::Calibration& calibration) {
  if (!opened) return opened;
  const capture::StreamInfo& info = (*opened)->info();
  if (info.width == calibration.width && info.height == calibration.height) return opened;
  return Error{info.description + ": the pictures are " + sizeText(info.width, info.height) +
               ", but the calibration is for " + sizeText(calibration.width, calibration.height)};
}

// The simulated markers are those the SLAM is told to look for.
simulator::LiveOptions simulatorOptions(const Configuration& configuration) {
  const Configuration::Camera& camera = configuration.camera;
  simulator::LiveOptions options;
  options.simulation.scene = camera.source.substr(kSimulated.size());
  options.simulation.dictionary = configuration.slam.dictionary;
  options.simulation.marker_size_m = configuration.slam.options.markers.size_m;
  options.simulation.seed = camera.simulator.seed;
  options.simulation.size = {camera.simulator.width, camera.simulator.height};
  if (camera.rate_hz > 0.0) options.simulation.rate_hz = camera.rate_hz;
  options.loop_s = camera.simulator.loop_s;
  if (!camera.simulator.truth_dir.empty()) options.truth_directory = camera.simulator.truth_dir;
  return options;
}

Result<CameraSetup> prepareSimulator(const Configuration& configuration) {
  const simulator::LiveOptions options = simulatorOptions(configuration);
  const Result<simulator::Scene> scene =
      simulator::buildScene(options.simulation, simulator::Ending::kClosedLoop);
  if (!scene) return Error{configuration.camera.source + ": " + scene.error().message};

  CameraSetup setup{.calibration = scene->camera, .calibration_change = {}, .opener = {}};
  setup.opener.open = [options]() -> OpenResult {
    Result<std::unique_ptr<simulator::LiveSimulatedSource>> opened = simulator::openLive(options);
    if (!opened) return opened.error();
    return std::unique_ptr<capture::FrameSource>(std::move(opened).value());
  };
  return setup;
}

capture::SourceOptions sourceOptions(const Configuration& configuration,
                                     const slam::Calibration& calibration, bool keep_jpeg) {
  // Of a full queue the oldest frame goes: those that wait, one at the SLAM and one just read.
  constexpr int kBesideTheQueue = 2;
  const Configuration::Camera& camera = configuration.camera;
  capture::SourceOptions options;
  options.realtime = true;
  options.recording_buffers = configuration.queue.depth + kBesideTheQueue;
  if (camera.rate_hz > 0.0) options.fps = camera.rate_hz;
  options.camera = camera.device;
  options.camera.keep_jpeg = keep_jpeg;
  if (options.camera.width == 0) {
    options.camera.width = calibration.width;
    options.camera.height = calibration.height;
  }
  return options;
}

struct PictureSize {
  int width = 0;   // pixels
  int height = 0;  // pixels
  std::string of;  // for messages: whose they are
};

// A recording is opened once to look at it, so that a wrong path or size is found before anything
// starts. A camera may be plugged in later: it will be asked for this size, or rejected.
Result<PictureSize> pictureSize(const std::string& source, const capture::CameraOptions& asked,
                                capture::Opener& open) {
  if (capture::isCamera(source)) return PictureSize{asked.width, asked.height, source};
  const OpenResult opened = open();
  if (!opened) return opened.error();
  const capture::StreamInfo& info = (*opened)->info();
  return PictureSize{info.width, info.height, info.description};
}

// keep_jpeg: frames carry the camera's own pictures along, for the recorder.
Result<CameraSetup> prepareSource(const Configuration& configuration, bool keep_jpeg) {
  const Configuration::Camera& camera = configuration.camera;
  slam::Calibration calibration;  // without a size where there is none
  if (!lensIsUnknown(configuration)) {
    const Result<slam::Calibration> read = io::readCalibration(camera.calibration);
    if (!read) return read.error();
    calibration = *read;
  }
  const capture::SourceOptions options = sourceOptions(configuration, calibration, keep_jpeg);
  Result<capture::Opener> opener = capture::sourceOpener(camera.source, options);
  if (!opener) return opener.error();
  const Result<PictureSize> size = pictureSize(camera.source, options.camera, *opener);
  if (!size) return size.error();
  if (lensIsUnknown(configuration)) {
    const slam::LensStartOptions& start = configuration.slam.options.lens.start;
    calibration = slam::guessedCamera(size->width, size->height, configuration.slam.fov_deg, start)
                      .calibration();
  }
  const Result<slam::FittedCalibration> fitted =
      slam::fitCalibration(calibration, size->width, size->height, camera.calibration_fit);
  if (!fitted) return Error{size->of + ": " + fitted.error().message};

  CameraSetup setup{
      .calibration = fitted->calibration, .calibration_change = fitted->change, .opener = {}};
  setup.opener.open = [open = std::move(opener).value(), expected = fitted->calibration]() mutable {
    return matching(open(), expected);
  };
  if (capture::isCamera(camera.source)) {
    setup.opener.comes_back = true;
    setup.opener.rate_hz = camera.rate_hz;
    setup.opener.exposure_s = camera.device.exposure_s.value_or(0.0);
    setup.opener.device_came = capture::monitorHotplug(camera.source);
  }
  return setup;
}

}  // namespace

Result<CameraSetup> prepareCamera(const Configuration& configuration) {
  const bool keep_jpeg = !configuration.record.directory.empty() && configuration.record.images;
  return configuration.camera.source.starts_with(kSimulated)
             ? prepareSimulator(configuration)
             : prepareSource(configuration, keep_jpeg);
}

}  // namespace waymark::daemon
