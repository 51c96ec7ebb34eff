// A video file as a frame source.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "base/result.h"
#include "capture/frame_source.h"

namespace waymark::capture {

// Any container and codec FFmpeg reads. Grey video keeps its bytes; colour is weighted to luma.
// Pixels come as stored: a rotation flag in the container is not applied, since a calibration is of
// the sensor.
//
// Times are the container's, where they grow; times that agree with a constant rate to a
// millisecond (the tick of Matroska) are taken to be exactly that rate's. `fps` overrides both.
// Sequence numbers count from 0.
//
// A file that decodes to fewer frames than its header promises, as a cut-off copy does, is an error
// at its end, or at once where the header is what is missing (MP4 has it last). A run on half a
// recording would look like a complete one. Matroska and WebM promise no number: what is cut off of
// them goes unnoticed. So does a cut within the very last frame, which comes out damaged.
[[nodiscard]] Result<std::unique_ptr<FrameSource>> openVideo(const std::filesystem::path& path,
                                                             std::optional<double> fps,
                                                             int buffers = kRecordingBuffers);

}  // namespace waymark::capture
