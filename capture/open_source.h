// From what a user typed to a frame source.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "base/result.h"
#include "capture/camera_options.h"
#include "capture/frame_source.h"

namespace waymark::capture {

// Cameras, as against recordings, are written with what they are asked through.
[[nodiscard]] bool isCamera(const std::string& spec);

struct SourceOptions {
  std::optional<double> fps;  // Hz; overrides the recording's own times, asks a camera for a rate
  bool realtime = false;      // play as if a camera were taking it now
  CameraOptions camera = {};  // for cameras only
  // Of a recording: frames that may be out at once. Until one is back no more are read, and in real
  // time that makes the newest ones late.
  int recording_buffers = kRecordingBuffers;
};

// Opens what a specification names as often as asked: a camera may come back, and must be the same.
using Opener = std::function<Result<std::unique_ptr<FrameSource>>()>;

// `spec` is a video file, an event log, a directory of images, or a camera: "v4l2:/dev/video0" and
// what else v4l2::parseCameraName() takes, "libcamera:0" or "libcamera:ID". Anything else is an
// error that says so. Nothing is opened yet.
[[nodiscard]] Result<Opener> sourceOpener(const std::string& spec, const SourceOptions& options);

// Tells when a camera may have come: true when one has since the last call. Does not wait.
using HotplugMonitor = std::function<bool()>;
[[nodiscard]] HotplugMonitor monitorHotplug(const std::string& spec);

// Opens it once.
[[nodiscard]] Result<std::unique_ptr<FrameSource>> openSource(const std::string& spec,
                                                              const SourceOptions& options);

}  // namespace waymark::capture
