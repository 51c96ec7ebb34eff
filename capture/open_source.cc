#include "capture/open_source.h"

#include <cmath>
#include <filesystem>
#include <string_view>
#include <utility>

#include "capture/image_directory_source.h"
#include "capture/libcamera/libcamera_source.h"
#include "capture/log_source.h"
#include "capture/paced_source.h"
#include "capture/v4l2/v4l2_source.h"
#include "capture/video_source.h"

namespace waymark::capture {
namespace {

using Opened = Result<std::unique_ptr<FrameSource>>;

constexpr std::string_view kV4l2 = "v4l2:";
constexpr std::string_view kLibcamera = "libcamera:";

template <typename CameraOpener>
Result<Opener> openerOf(Result<CameraOpener> created) {
  if (!created) return created.error();
  return Opener([opener = std::move(created).value()]() mutable { return opener.open(); });
}

Result<Opener> cameraOpener(const std::string& spec, const SourceOptions& options) {
  CameraOptions camera = options.camera;
  if (options.fps) camera.rate_hz = *options.fps;
  return spec.starts_with(kV4l2)
             ? openerOf(V4l2Opener::create(spec.substr(kV4l2.size()), camera))
             : openerOf(LibcameraOpener::create(spec.substr(kLibcamera.size()), camera));
}

Opened openRecording(const std::string& spec, const SourceOptions& options) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(spec, error);
  if (!std::filesystem::exists(status)) {
    const bool has_scheme = spec.find(':') != std::string::npos;
    return Error{spec + (has_scheme ? ": unknown kind of source" : ": no such file or directory") +
                 "; a source is a video file, an event log, a directory of images or a camera "
                 "(v4l2:..., libcamera:...)"};
  }
  // A pipe: it is read more than once, and opening it may wait for ever.
  if (!std::filesystem::is_directory(status) && !std::filesystem::is_regular_file(status)) {
    return Error{spec + ": is neither a file nor a directory"};
  }
  const int buffers = options.recording_buffers;
  Opened opened = std::filesystem::is_directory(status)
                      ? openImageDirectory(spec, options.fps, buffers)
                  : isEventLog(spec) ? openLog(spec, options.fps, options.camera.keep_jpeg, buffers)
                                     : openVideo(spec, options.fps, buffers);
  if (!opened || !options.realtime) return opened;
  return playInRealTime(std::move(opened).value(), options.fps);
}

}  // namespace

bool isCamera(const std::string& spec) {
  return spec.starts_with(kV4l2) || spec.starts_with(kLibcamera);
}

Result<Opener> sourceOpener(const std::string& spec, const SourceOptions& options) {
  if (options.fps && !(*options.fps > 0.0 && std::isfinite(*options.fps))) {
    return Error{spec + ": the frame rate must be positive"};
  }
  // NOLINTNEXTLINE(clang-analyzer-cplusplus.NewDeleteLeaks): it loses sight of what moves.
  if (isCamera(spec)) return cameraOpener(spec, options);
  return Opener([spec, options] { return openRecording(spec, options); });
}

HotplugMonitor monitorHotplug(const std::string& spec) {
  if (!isCamera(spec)) return [] { return false; };
  return [arrivals = std::make_shared<v4l2::CameraArrivals>()] { return arrivals->any(); };
}

Opened openSource(const std::string& spec, const SourceOptions& options) {
  const Result<Opener> opener = sourceOpener(spec, options);
  return opener ? opener.value()() : Opened(opener.error());
}

}  // namespace waymark::capture
