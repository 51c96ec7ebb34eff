// What is asked of a camera, in libcamera's terms.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <libcamera/camera.h>
#include <libcamera/controls.h>
#include <libcamera/pixel_format.h>
#include <libcamera/stream.h>

#include "base/result.h"
#include "capture/camera_options.h"
#include "capture/mode_choice.h"

namespace waymark::capture::libcam {

// libcamera names formats as the kernel's display side does, we as its camera side: the same
// FourCC but for pictures of one colour and of whole ones. Empty for what has no such name.
[[nodiscard]] std::optional<std::uint32_t> v4l2Fourcc(const libcamera::PixelFormat& format);

// Formats and sizes of a stream; rates are known when it runs.
[[nodiscard]] std::vector<OfferedMode> offeredModes(const libcamera::StreamConfiguration& stream);

// Chooses and sets format, size and number of buffers of the first stream. What the camera would
// make something else of is an error.
[[nodiscard]] Result<ChosenMode> applyMode(const CameraOptions& options,
                                           libcamera::CameraConfiguration* configuration);

// Exposure, rate and named controls for Camera::start(); a line for each that the camera lacks.
[[nodiscard]] libcamera::ControlList startControls(const libcamera::Camera& camera,
                                                   const CameraOptions& options,
                                                   std::vector<std::string>* warnings);

}  // namespace waymark::capture::libcam
