// A directory of images as a frame source.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "base/result.h"
#include "capture/frame_source.h"

namespace waymark::capture {

// The .jpg .jpeg .png .pgm .bmp .tif .tiff files of a directory (in any case), in the byte order of
// their names. With a `frames.txt` beside them, its lines "FILE SECONDS" ('#' begins a comment)
// name the frames in order and their times, which must grow. Else frames come at `fps`, or 30 Hz,
// which info().description then says. `fps` overrides the times of frames.txt, not its order.
//
// Pixels come as stored: an EXIF orientation is not applied, since a calibration is of the sensor.
// The size of the first image holds for all. An unreadable image or one of another size is an error
// that names it; so is a directory without images.
[[nodiscard]] Result<std::unique_ptr<FrameSource>> openImageDirectory(
    const std::filesystem::path& path, std::optional<double> fps, int buffers = kRecordingBuffers);

}  // namespace waymark::capture
