// Frames of a V4L2 camera: a webcam, a camera module, a frame grabber.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "base/result.h"
#include "capture/camera_options.h"
#include "capture/frame_source.h"
#include "capture/v4l2/camera_list.h"

namespace waymark::capture {

// Opens one camera, as often as it comes back. It remembers which it was, so that another one which
// has got its number meanwhile is not taken for it.
class V4l2Opener {
 public:
  // `name` as parseCameraName() takes it. Wrong options are found before any camera is there.
  [[nodiscard]] static Result<V4l2Opener> create(const std::string& name,
                                                 const CameraOptions& options);

  // Finds the camera, sets format, size, rate and controls, and starts it. What it gives instead of
  // what was asked is among the source's warnings, where it can be used at all.
  //
  // Grey planes are not copied: their frames are the driver's buffers, which the camera gets back
  // when the frame is let go. All else is converted into buffers of our own.
  [[nodiscard]] Result<std::unique_ptr<FrameSource>> open();

 private:
  V4l2Opener(v4l2::CameraName name, CameraOptions options)
      : name_(std::move(name)), options_(std::move(options)) {}

  v4l2::CameraName name_;
  CameraOptions options_;
  std::optional<v4l2::CameraIdentity> known_;
};

}  // namespace waymark::capture
