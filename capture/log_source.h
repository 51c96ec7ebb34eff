// Frames of an LCM event log, as the daemon or another program recorded them.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "base/result.h"
#include "capture/frame_source.h"

namespace waymark::capture {

// Does the file begin as an event log does? False also when it cannot be read.
[[nodiscard]] bool isEventLog(const std::filesystem::path& file);

// The bot_core images of the log in their order, whatever their channel: grey ones, and JPEG. A
// recording in several files (eventlog/recording_name.h) goes on from `file` to the last one. All
// have the size of the first; without any, this is an error. What is damaged is skipped and told by
// damage(). fps: instead of the recorded times. keep_jpeg: frames carry compressed pictures along.
[[nodiscard]] Result<std::unique_ptr<FrameSource>> openLog(const std::filesystem::path& file,
                                                           std::optional<double> fps,
                                                           bool keep_jpeg = false,
                                                           int buffers = kRecordingBuffers);

}  // namespace waymark::capture
